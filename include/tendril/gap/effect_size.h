// How large an effect is in the channel where it shows most, in units of the noise floor ("3 sigma of
// backlash"). Knows nothing of causes or verdicts.
#pragma once

#include <memory>
#include <string>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

class EffectRuler {
 public:
  struct Size {
    double floors = 0;    // largest ratio, over all channels, of the rms change to the rms floor
    std::string channel;  // "tension 1 from torque", "tip position", ...
  };

  /// `runs`: measured runs of the nominal robot, with sensor noise. Throws std::runtime_error when they
  /// cannot be compared with a simulation.
  EffectRuler(const DataSet& runs, int threads);
  ~EffectRuler();

  /// Simulates every cut with and without the effect, driven by the same measured signals on its near side,
  /// and compares the change on its far side with the floors of the diagnosis. Throws std::runtime_error when
  /// the robot with the effect cannot be simulated.
  Size Of(const EffectSetting& effect) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tendril::gap
