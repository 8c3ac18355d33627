// Which single change of a robot explains its postures after something happened, its numbers shared with
// those from before. Knows nothing of verdicts.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "../file_numbers.h"
#include "../hypothesis.h"
#include "learn_postures.h"

namespace tendril::gap {

/// One thing that may have changed: an effect of the registry at one place, or a number of the file.
struct PostureChange {
  std::optional<Candidate> effect;   // empty: a number
  std::optional<FileNumber> number;  // empty: an effect
  Eigen::VectorXd deviation;  // prior standard deviation of each parameter: of a factor of its exponent
  /// z: from no change, in prior deviations.
  std::function<void(PostureRobot&, const Eigen::VectorXd& z)> apply;

  int size() const { return static_cast<int>(deviation.size()); }
  /// Of a parameter that is z prior deviations from no change.
  double ValueAt(int parameter, double z) const;
  /// Which parameter lies outside the range of the registry, as a clause; empty: none.
  std::string OutOfRange(const Eigen::VectorXd& z) const;
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
  int change = -1;    // index; -1: nothing changed
  Eigen::VectorXd z;  // parameters at the maximum, in prior deviations
  double log_evidence = 0;
  double log_prior = 0;        // among all: shared evenly by the effects, and by the places of each
  Eigen::MatrixXd covariance;  // of z, the numbers being as uncertain as they are
  double moves = 0;            // largest rms move of a point by the change, over the least that matters there
  Eigen::MatrixXd held_out_m;  // measured less predicted, each quarter with what the others give
  bool refined = false;        // false: one step from no change, without the two before

  double LogJoint() const { return log_prior + log_evidence; }
};

struct ChangeSearch {
  std::vector<PostureChange> changes;
  std::vector<ChangeFit> fits;  // by falling probability; those that may be named are refined
  double none_log_evidence = 0;
  double unlisted_log_evidence = 0;  // of a change of another kind: any smooth function of the motors' angles
  Eigen::MatrixXd before_m;          // residuals with the numbers from before
  Eigen::MatrixXd as_filed_m;        // with those of the file
};

struct ChangeOptions {
  int refits = 6;
  double delta_m = 0;                  // moves of a point that do not matter; 0: see LeastThatMatters
  std::vector<std::string> without{};  // effects that are no hypotheses
  int threads = 1;
  std::function<void(double)> progress{};
};

/// Rms move of a point (from 0) that matters [m]: `delta_m`, and at least a share of the floor. Of a turn by
/// as much as moves the end of a straight body by that.
double LeastThatMatters(const LearnedPostures& learned, int point, double delta_m);
/// Rms beyond the floor of a point (from 0) [m].
double Excess(const LearnedPostures& learned, const Eigen::MatrixXd& residuals_m, int point);
/// It is more than does not matter.
bool HasExcess(const LearnedPostures& learned, const Eigen::MatrixXd& residuals_m, int point, double delta_m);

/// `before`: the states that `learned` was inferred from; `after`: its points are theirs.
ChangeSearch SearchChange(const LearnedPostures& learned, const RobotParameters& file, const Postures& before,
                          const Postures& after, const ChangeOptions& options);

}  // namespace tendril::gap
