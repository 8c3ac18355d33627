// How large an effect is where it shows most, in floors of the noise: what "3 sigma of backlash" means.
// Knows nothing of causes or verdicts.
#pragma once

#include <memory>
#include <string>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

class EffectRuler {
 public:
  struct Size {
    double floors = 0;    // rms change over the rms floor, in the channel where that is most
    std::string channel;  // "tension 1 from torque", "tip position", ...
  };

  /// `runs`: measured runs of the robot as its file says, with the sensors' noise. Throws std::runtime_error
  /// when they cannot be compared with a simulation.
  EffectRuler(const DataSet& runs, int threads);
  ~EffectRuler();

  /// Every cut is simulated with and without the effect from the same measured signals on its near side; the
  /// difference on its far side is the change, the floors are those of the diagnosis. Throws
  /// std::runtime_error when the robot with the effect cannot be simulated.
  Size Of(const EffectSetting& effect) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tendril::gap
