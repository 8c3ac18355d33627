// Which single change of a robot explains its postures after something happened, its numbers shared with
// those from before. Knows nothing of verdicts.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <string>
#include <vector>

#include "../file_numbers.h"
#include "../hypothesis.h"
#include "learn_postures.h"

namespace tendril::gap {

/// One thing that may have changed: an effect of the registry at one place, or a number of the file.
struct PostureChange {
  std::string name;                  // "tip_payload", "actuation.spool.radius_m"
  std::optional<Candidate> effect;   // empty: a number
  std::optional<FileNumber> number;  // empty: an effect
  Eigen::VectorXd deviation;         // prior standard deviation of each parameter, in its unit
  /// z: from no change, in prior deviations.
  std::function<void(PostureRobot&, const Eigen::VectorXd& z)> apply;

  int size() const { return static_cast<int>(deviation.size()); }
  /// z, or the nearest that can be: no mass is negative.
  Eigen::VectorXd Possible(Eigen::VectorXd z) const;
  /// Log of the density of z's prior over that of one to both sides.
  double LogOneSided() const;
};

/// Every effect of the registry that statics can show, and every number of the file that is none of them.
std::vector<PostureChange> PostureChanges(const RobotParameters& robot,
                                          const std::vector<std::string>& without);

/// A hypothesis fitted to the states after the change together with the robot's numbers.
struct ChangeFit {
  int change = -1;       // index; -1: nothing changed
  Eigen::VectorXd x, z;  // numbers and parameters at the maximum, in prior deviations
  double sigma = 0;      // largest rms move of a disk by the change, over its floor
  double squares = 0;    // of whitened residuals and of the distances from both priors
  double log_evidence = 0;
  Eigen::MatrixXd covariance;  // of z, the numbers being what they are
  Eigen::MatrixXd left_m;      // measured less predicted, S x 3P
  Eigen::MatrixXd held_out_m;  // the same, each quarter predicted by the others
  bool refined = false;        // false: one step from no change
};

struct ChangeSearch {
  std::vector<PostureChange> changes;
  std::vector<ChangeFit> fits;  // by falling evidence
  ChangeFit none;
  double unlisted_log_evidence = 0;  // of a change of another kind: any smooth function of the motors' angles
  Eigen::MatrixXd before_m;          // residuals with the numbers from before
  Eigen::MatrixXd as_filed_m;        // with those of the file
};

struct ChangeOptions {
  int refits = 6;
  std::vector<std::string> without{};  // effects that are no hypotheses
  int threads = 1;
  std::function<void(double)> progress{};
};

/// `after`: the disks are those of the states that `learned` was inferred from.
ChangeSearch SearchChange(const LearnedPostures& learned, const RobotParameters& file, const Postures& after,
                          const ChangeOptions& options);

}  // namespace tendril::gap
