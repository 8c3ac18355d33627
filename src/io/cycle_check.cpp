#include "cycle_check.h"

#include <algorithm>

#include "tendril/core/cycle.h"

namespace tendril::io {

bool CycleCheck::Possible(const tendril_lcm::cycle_t& m) {
  const auto flag = [](std::int8_t value) { return value == 0 || value == 1; };
  const auto up_to = [](auto value, int most) { return value >= 0 && value <= most; };
  const auto every = [](const auto& values, auto good) {
    return std::all_of(values.begin(), values.end(), good);
  };
  const double(&q)[4] = m.orientation_estimate_WT;
  const bool good =
      flag(m.bus_ok) && flag(m.late) && flag(m.tracker_valid) && flag(m.clear_drive_faults) &&
      flag(m.drive_request) && up_to(m.mode, static_cast<int>(Mode::kCommissioning)) &&
      up_to(m.command_kind, tendril_lcm::cycle_t::COMMAND_MODE) &&
      every(m.drive_state, [&](auto s) { return up_to(s, tendril_lcm::cycle_t::DRIVE_ID_TWICE); }) &&
      every(m.drive_statusword, [&](auto word) { return up_to(word, 0xFFFF); }) &&
      (m.time_ns != 0 || !every(m.drive_state, [](auto s) { return s == 0; })) &&
      !(q[0] == 0 && q[1] == 0 && q[2] == 0 && q[3] == 0);
  return good && ClocksAgree(m);
}

bool CycleCheck::ClocksAgree(const tendril_lcm::cycle_t& m) {
  const std::int64_t epoch_us = m.utime - m.time_ns / kNsPerUs;
  const bool agrees = !known_ || epoch_us == epoch_us_ || m.cycle < cycle_;
  known_ = true;
  if (!agrees) return false;
  epoch_us_ = epoch_us;
  cycle_ = m.cycle;
  return true;
}

}  // namespace tendril::io
