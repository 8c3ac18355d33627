#include "tendril/core/status.h"

namespace tendril {

std::string_view StatusText(Status status) noexcept {
  switch (status) {
#define TENDRIL_STATUS_TEXT(name, number, text, remedy) \
  case Status::k##name:                                 \
    return text;
    TENDRIL_STATUS_LIST(TENDRIL_STATUS_TEXT)
#undef TENDRIL_STATUS_TEXT
  }
  return "unknown status";
}

std::string_view StatusRemedy(Status status) noexcept {
  switch (status) {
#define TENDRIL_STATUS_REMEDY(name, number, text, remedy) \
  case Status::k##name:                                   \
    return remedy;
    TENDRIL_STATUS_LIST(TENDRIL_STATUS_REMEDY)
#undef TENDRIL_STATUS_REMEDY
  }
  return "";
}

std::span<const StatusEntry> Statuses() noexcept {
  static constexpr StatusEntry kAll[] = {
#define TENDRIL_STATUS_ENTRY(name, number, text, remedy) {Status::k##name, #name},
      TENDRIL_STATUS_LIST(TENDRIL_STATUS_ENTRY)
#undef TENDRIL_STATUS_ENTRY
  };
  return kAll;
}

std::span<const StatusBlock> StatusBlocks() noexcept {
  static constexpr StatusBlock kBlocks[] = {
      {0, "Fine", "Nothing to do."},
      {100, "Limited", "The output is limited; the text names the limit and its key."},
      {200, "Refused", "A command was refused and changes nothing."},
      {300, "Degraded", "Something is not as it should be; the robot goes on, holds or disarms."},
      {400, "Faults", "A fault latches: tensions ramp down, drives are disabled, and only clear ends it."},
  };
  return kBlocks;
}

bool ExplainsMode(Status status) noexcept {
  switch (status) {
    case Status::kCommandsSilent:
    case Status::kCommissioningEnded:
    case Status::kDriveHasFault:
    case Status::kDriveAbsent:
    case Status::kOtherDevice:
    case Status::kDriveMisconfigured:
    case Status::kNodeIdTwice:
    case Status::kCyclesMissed:
      return true;
    default:
      return IsFault(status);
  }
}

}  // namespace tendril
