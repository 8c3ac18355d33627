// The numbers of the robot file as hypotheses: each may be wrong by any factor, including a unit error or
// diameter for radius. Knows nothing of effects or probabilities.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "fit.h"
#include "tendril/sim/effects.h"

namespace tendril::gap {

/// One number of the robot file, common to all tendons or sections, or of one tendon.
struct FileNumber {
  std::string key;     // "actuation.gear.ratio", "body.sections.tendons (tendon 2) angle_rad"
  double in_file = 0;  // its value; that of the first tendon or section where they differ
  bool angle = false;  // changed by addition [rad]; otherwise by a factor
  sim::Stage stage{};  // where in the chain it is
  sim::Element element{};
  /// Changes it in a robot: by a factor exp(change), or an angle by change [rad].
  std::function<void(RobotParameters&, double change)> apply{};
  /// The library effect that changes the same number, and searches it within its own bounds; empty: none.
  std::string effect{};
  int tendon = 0;  // whose own it is, from 1; 0: common to all
  /// False where no uncertainty of the file is one of this number: a disk's inertia moves with its mass,
  /// counts are whole and wrong by mistake, and each number of a list may be uncertain by itself, not all by
  /// one factor.
  bool may_be_open = true;

  double ValueAt(double change) const;
  double ChangeTo(double value) const;
};

/// The numbers of `robot` that a replay depends on, but for the pretension (the same as another zero of the
/// motors), the tracker's delay and the constants that only smooth friction. Zeros are omitted: a factor does
/// not change them.
std::vector<FileNumber> FileNumbers(const RobotParameters& robot);

/// A number's key without its tendon: "body.sections.tendons.radius_m" of "body.sections.tendons (tendon 2)
/// radius_m".
std::string WithoutTendon(const std::string& key);

/// A number fitted to the runs.
struct NumberFit {
  FileNumber number;
  double value = 0;     // in its unit
  double score = 0;     // log score over all channels, nuisances free
  Residuals residuals;  // residuals with this value, nuisances subtracted
};

/// The best `count` of them by falling score. Each is followed on the run with the largest gap, the first of
/// them also on a few, with one model discrepancy for all channels; the best are refined on all runs with the
/// `leftover` and nuisances used for the causes. `progress`:
/// from 0 to 1.
std::vector<NumberFit> FitNumbers(const Evaluator& evaluator, const Eigen::VectorXd& leftover,
                                  const Nuisances& nuisances, const Folds& folds, int count, int threads,
                                  const std::function<void(double)>& progress);

}  // namespace tendril::gap
