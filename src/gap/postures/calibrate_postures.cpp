#include "calibrate_postures.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "../interval.h"
#include "../readable.h"
#include "directions.h"
#include "learn_postures.h"
#include "tendril/core/parallel.h"

namespace tendril::gap {
namespace {

class Calibrating {
 public:
  Calibrating(const DataSet& given, const CalibrateOptions& options)
      : file_(given.robot), readable_(Readable(given, found_.notes)) {
    RefuseContradictions(readable_);
    std::vector<const Run*> runs;
    for (const Run& run : readable_.set.runs) runs.push_back(&run);
    postures_ = PosturesOf(runs, file_);
    for (std::string& line : ReadDirections(postures_, file_)) found_.notes.push_back(std::move(line));
    LearnPosturesOptions learning;
    learning.threads = options.threads > 0 ? options.threads : AllCores();
    learning.progress = [&options](double fraction) {
      if (options.progress) options.progress("learning the robot's numbers", fraction);
    };
    learned_ = LearnPostures(file_, postures_, !readable_.set.fit_frame, learning);
  }

  Calibration Result() {
    found_.converged = learned_.converged;
    if (!learned_.Predicts()) found_.not_learned = NotLearnedText(learned_, postures_, "these runs");
    found_.iterations = learned_.steps;
    found_.held_out_by = "quarters of the runs";
    for (const auto& [key, uncertainty] : file_.uncertain) {
      if (uncertainty.kind == Uncertainty::Kind::kKnown) found_.known.push_back(key);
    }
    ListNumbers();
    ListChannels();
    Notes();
    PostureRobot robot;  // without the tracker's frame and what else no file holds
    robot.robot = file_;
    robot.zero_m = Eigen::VectorXd::Zero(file_.body.tendons());
    for (std::size_t k = 0; k < learned_.numbers.size(); ++k) {
      const PostureNumber& number = learned_.numbers[k];
      if (!number.assumed) number.apply(robot, learned_.x[static_cast<Eigen::Index>(k)]);
    }
    found_.robot = std::move(robot.robot);
    return std::move(found_);
  }

 private:
  void ListNumbers() {
    const Eigen::MatrixXd covariance = learned_.precision.inverse();
    const Eigen::VectorXd deviation = covariance.diagonal().cwiseSqrt();
    found_.correlation =
        deviation.cwiseInverse().asDiagonal() * covariance * deviation.cwiseInverse().asDiagonal();
    for (std::size_t k = 0; k < learned_.numbers.size(); ++k) {
      const PostureNumber& number = learned_.numbers[k];
      const auto i = static_cast<Eigen::Index>(k);
      double& x = learned_.x[i];
      const double value = number.ValueAt(file_, x);
      const double per_change = number.additive ? number.per_change : std::abs(value);
      x = number.ChangeTo(file_, RoundedTo(value, deviation[i] * per_change));
      CalibratedNumber c;
      c.key = number.key;
      c.unit = number.unit;
      c.additive = number.additive;
      c.of_file = static_cast<bool>(number.value) && !number.assumed;
      c.in_file = number.ValueAt(file_, 0);
      c.value = number.ValueAt(file_, x);
      c.prior = number.deviation * number.per_change;
      c.deviation = std::min(deviation[i], number.deviation) * number.per_change;
      c.low = number.ValueAt(file_, x - kTwoSided95 * deviation[i]);
      c.high = number.ValueAt(file_, x + kTwoSided95 * deviation[i]);
      if (c.low > c.high) std::swap(c.low, c.high);
      found_.numbers.push_back(std::move(c));
    }
  }

  void ListChannels() {
    const TrackerParameters tracker = file_.actuation->tracker.value_or(TrackerParameters{});
    for (Eigen::Index c = 0; c < learned_.held_out_m.cols(); ++c) {
      const double per_unit = postures_.PerUnit(c), held_out = ChannelRms(learned_.held_out_m, c) / per_unit;
      const double noise = postures_.IsTurn(c) ? tracker.orientation_noise_rad : tracker.position_noise_m;
      found_.channels.push_back({postures_.ChannelName(c), postures_.UnitOf(c),
                                 ChannelRms(learned_.as_filed_m, c) / per_unit, held_out, noise,
                                 std::sqrt(std::max(0.0, held_out * held_out - noise * noise))});
    }
  }

  void Notes() {
    for (const std::string& note : readable_.set.notes) found_.notes.push_back(note);
    found_.notes.push_back(
        "neither torques nor tensions: weights and stiffnesses are known relative to each other, and numbers "
        "of drives, friction and damping stay as they are in the file");
    const auto& tendons = file_.actuation->tendons;
    if (std::any_of(tendons.begin(), tendons.end(),
                    [](const auto& drive) { return drive.transmission.pulleys.empty(); })) {
      found_.notes.push_back(
          "the file draws no pulleys: friction was learned as that of sheaths, and is not in the new file");
    }
    if (std::string drift = ClockDriftText(learned_); !drift.empty())
      found_.notes.push_back(std::move(drift));
    for (std::string& line : postures_.Lost()) found_.notes.push_back(std::move(line));
    if (learned_.unsolved > 0)
      found_.notes.push_back(
          fmt::format("{} states without an equilibrium of the learned robot", learned_.unsolved));
  }

  RobotParameters file_;  // with directions that it calls unknown read from the runs
  Calibration found_;
  const ReadableSet readable_;
  Postures postures_;
  LearnedPostures learned_;
};

}  // namespace

bool CanCalibratePostures(const DataSet& set) {
  if (!ShowsPostures(set)) return false;
  std::vector<const Run*> runs;
  for (const Run& run : set.runs) runs.push_back(&run);
  return EnoughPostures(runs, set.robot);
}

Calibration CalibratePostures(const DataSet& set, const CalibrateOptions& options) {
  return Calibrating(set, options).Result();
}

}  // namespace tendril::gap
