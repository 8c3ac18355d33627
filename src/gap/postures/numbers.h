// The numbers of a robot that its postures depend on, each with what is known of it: those of the file, and
// what no file can hold. Knows nothing of runs.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "predict.h"

namespace tendril::gap {

/// Key of the number PostureRobot::clock_drift.
inline constexpr const char* kClockDrift = "gain of the tracker's clock on the motors'";

struct PostureNumber {
  std::string key;   // "body.sections[1].youngs_modulus_Pa"; in plain words where the file does not hold it
  std::string unit;  // "Pa"
  double deviation = 0;  // prior standard deviation of the change
  /// Changed by addition of change times `per_change` [unit]; otherwise by a factor exp(change).
  bool additive = false;
  double per_change = 1;
  std::function<void(PostureRobot&, double change)> apply{};
  /// Its value in a robot of the file; empty for a number that the file does not hold, which is 0 there.
  std::function<double(const RobotParameters&)> value{};
  bool assumed = false;  // what the file leaves out, with a usual value in its place

  double ValueAt(const RobotParameters& file, double change) const;
  double ChangeTo(const RobotParameters& file, double value) const;
};

/// A robot of whose tendons' paths the file draws nothing has sheaths there.
RobotParameters WithSheaths(RobotParameters robot);

/// Those that are not known exactly. `frame_is_known`: the tracker's readings are in the base frame but for
/// the care of whoever placed it; otherwise they were turned and shifted by a guess. `points`: what is seen.
std::vector<PostureNumber> PostureNumbers(const RobotParameters& robot, bool frame_is_known,
                                          const std::vector<PosturePoint>& points);

/// The robot of the file with these changes.
PostureRobot WithNumbers(const PostureRobot& file, const std::vector<PostureNumber>& numbers,
                         const Eigen::VectorXd& changes);

}  // namespace tendril::gap
