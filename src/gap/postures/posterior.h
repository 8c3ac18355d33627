// Probabilities of what may have changed, from the evidence of each. Knows nothing of words or files.
#pragma once

#include <string>
#include <vector>

#include "changes.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// A change that moves no disk by this many floors does not matter.
inline constexpr double kMatters = 0.5;

struct ChangePosterior {
  double none = 0, unlisted = 0;   // nothing that matters; something that is no hypothesis
  std::vector<double> fits;        // of ChangeSearch::fits; with the others 1
  std::vector<int> group;          // of each: 1 where these states do not tell it from the first, else 0
  double excess_sigma = 0;         // of the states after, with the numbers from before, at the worst disk
  double leftover_sigma = 0;       // of the best fit, predicted
  std::optional<Estimate> closed;  // by the best fit, predicted; empty where there was no excess
  std::string doubt;               // why the best is not established, as a clause; empty where it is
};

/// rms distance of a disk (from 0) over all states.
double DiskRms(const Eigen::MatrixXd& left_m, int disk);
/// sqrt(rms^2 - floor^2) / floor.
double ExcessSigma(double rms, double floor);

ChangePosterior PosteriorOf(const LearnedPostures& learned, const ChangeSearch& search);

}  // namespace tendril::gap
