// Measured runs as an LCM log in the daemon's format, in its drives' units. Knows the daemon's messages,
// nothing of where the runs came from.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// What a log cannot hold of a set, although a folder can.
struct LostInLog {
  /// Channels that some run lacks, by name ("tension"): a log has zeros for them.
  std::vector<std::string> channels;
  /// Motor positions of some run begin elsewhere than at zero: a log's zero is the initial rest of each run.
  bool start_position = false;
};
LostInLog WhatALogLoses(const DataSet& set);

struct WrittenLog {
  std::uint64_t events = 0;
  std::uint64_t clipped = 0;  // values beyond the range of the drives' units
};
/// Writes the runs one after the other, each row at its time as a cycle; between two runs a cycle with the
/// drives not in motion, by which a reader tells them apart. The set's robot has actuation. Throws
/// std::runtime_error when the log cannot be written whole.
WrittenLog WriteLog(const DataSet& set, const std::string& path);

}  // namespace tendril::gap
