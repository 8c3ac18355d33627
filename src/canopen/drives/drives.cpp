// The kinds of drive, a row each. Knows none of them inside.
#include <stdexcept>

#include "cia402/cia402_drive.h"
#include "tendril/canopen/drive_profile.h"

namespace tendril::canopen {
namespace {

struct Row {
  DriveKind kind;
  DriveProfilePtr (*profile)(const NodeParameters& node);
};

constexpr Row kRows[] = {
    {DriveKind::kEpos4, [](const NodeParameters&) { return Epos4Profile(); }},
    {DriveKind::kCia402, cia402::Profile},
};

}  // namespace

DriveProfilePtr ProfileOf(const NodeParameters& node) {
  for (const Row& row : kRows) {
    if (row.kind == node.profile) return row.profile(node);
  }
  throw std::invalid_argument("node " + std::to_string(node.node_id) + ": its kind of drive has no profile");
}

}  // namespace tendril::canopen
