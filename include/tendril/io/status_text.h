// What a daemon publishes about itself, for people and for programs. Knows the messages, not how they came.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include "tendril_lcm/state_t.hpp"
#include "tendril_lcm/statistics_t.hpp"

namespace tendril::io {

/// Who answers, from the run record.
struct DaemonSubject {
  std::string daemon;      // host and process
  std::string robot, bus;  // names; empty: not known
  /// What an error code means to the drive at a node; empty for a drive that is not known.
  std::function<std::optional<std::string>(int node_id, std::uint16_t code)> error_meaning;
};

/// A daemon as last heard. Statistics and run record come once a second.
struct DaemonStatus {
  tendril_lcm::state_t state{};
  std::optional<tendril_lcm::statistics_t> statistics;
  std::optional<DaemonSubject> subject;
};

/// DRIVE_... of cycle_t in words: "enabled"; "?" for another number.
std::string_view DriveStateText(int state);

/// Lines for a terminal: who it is, mode and reasons with their remedies, tip [mm], bends [deg], tendons
/// [N, mm, mNm]; with statistics also drives, last fault, times [us], CAN and LCM. A dash is a value that is
/// not known.
std::string StatusTable(const DaemonStatus& status);

/// One JSON object without line breaks: every field of the state in the message's units, `robot`, `bus` and
/// `daemon` with a run record, `statistics` with statistics. NaN becomes null.
std::string StatusJson(const DaemonStatus& status);

/// Why there is nothing to show: no daemon answered within some time. `waits`: the last line of a daemon that
/// waits for its networks (Client::waits), or empty.
std::string NobodyAnswersText(const std::string& url, const std::string& channel_prefix, double within_s,
                              const std::string& waits);

}  // namespace tendril::io
