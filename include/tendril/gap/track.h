// Follows a robot from day to day: what each effect alone would have to be to explain the runs, with its
// standard deviation and the change that matters. Knows nothing of other days, causes or verdicts.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

struct TrackOptions {
  double delta_N = 0, delta_m = 0;  // materiality; 0: derived from the noise floor
  int threads = 0;                  // 0: all cores
  std::uint64_t seed = 1;           // of the alternative readings of the sensors
  /// Beyond the noise, by name of a channel: what the model itself gets wrong. Empty: estimated from these
  /// runs. Days are weighed alike where they are given that of the first, and a change does not hide behind
  /// the discrepancy that it makes.
  std::map<std::string, double> discrepancy;
  /// Called from several threads concurrently.
  std::function<void(const std::string& stage, double fraction)> progress;
};

/// A parameter of an effect, alone but for the nuisances (and the effect's other parameters), to first order
/// about the robot. Unbounded, so that its error is Gaussian: a friction may be negative within it.
struct TrackedParameter {
  std::string effect, where, name;  // "cell_offset", "tendon:2", "N"
  double value = 0, deviation = 0;  // one standard deviation
  /// Change of the value that moves the channel where it shows most by its materiality (rms).
  double material = 0;
};

struct TrackedChannel {
  std::string name, unit;  // "tension 1 from torque", "N"
  double rms = 0, floor = 0, delta = 0;
  double discrepancy = 0;  // what the best effect leaves beyond the noise
};

struct Tracking {
  std::vector<TrackedParameter> parameters;  // in the registry's order
  std::vector<TrackedChannel> channels;
  std::vector<std::string> notes;  // what was left out of the runs, and why
};

/// The effects that these runs can show, but for those without a response before an onset (a contact, a
/// limit). The result depends only on set, options and seed. Throws std::runtime_error where nothing can be
/// compared.
Tracking Track(const DataSet& set, const TrackOptions& options);

std::string TrackingJson(const Tracking& tracking);

}  // namespace tendril::gap
