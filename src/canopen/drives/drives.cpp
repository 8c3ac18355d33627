// The kinds of drive, a row each. Knows none of them inside.
#include <stdexcept>

#include "cia402/cia402_drive.h"
#include "epos4/epos4.h"
#include "tendril/canopen/drive_profile.h"

namespace tendril::canopen {
namespace {

struct Row {
  DriveKind kind;
  DriveProfilePtr (*profile)(const NodeParameters& node);
  std::span<const EmcyInfo> (*emcy)() noexcept;
};

constexpr Row kRows[] = {
    {DriveKind::kEpos4, [](const NodeParameters&) { return Epos4Profile(); }, epos4::EmcyTable},
    {DriveKind::kCia402, cia402::Profile, cia402::EmcyTable},
};

}  // namespace

DriveProfilePtr ProfileOf(const NodeParameters& node) {
  for (const Row& row : kRows) {
    if (row.kind == node.profile) return row.profile(node);
  }
  throw std::invalid_argument("node " + std::to_string(node.node_id) + ": its kind of drive has no profile");
}

std::span<const EmcyInfo> EmcyOf(DriveKind kind) noexcept {
  for (const Row& row : kRows) {
    if (row.kind == kind) return row.emcy();
  }
  return cia402::EmcyTable();
}

}  // namespace tendril::canopen
