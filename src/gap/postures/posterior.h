// Probabilities of what may have changed, from the evidence of each. Knows nothing of words or files.
#pragma once

#include <string>
#include <vector>

#include "changes.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

struct ChangePosterior {
  double none = 0, unlisted = 0;   // nothing that matters; something that is no hypothesis
  std::vector<double> fits;        // of ChangeSearch::fits; with the others 1
  std::vector<char> same;          // of each: these states do not tell it from the first
  bool not_learned = false;        // too little of the robot from before, to tell anything
  double leftover_sigma = 0;       // of the best fit, predicted
  std::optional<Estimate> closed;  // by the best fit, predicted; empty where there was no excess
  std::string doubt;               // why the best is not established, as a clause; empty where it is
};

ChangePosterior PosteriorOf(const LearnedPostures& learned, const ChangeSearch& search, double delta_m);

}  // namespace tendril::gap
