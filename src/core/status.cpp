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
