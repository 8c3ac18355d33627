// Means over equal times.
#include "states.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <stdexcept>

#include "../rotation.h"

namespace tendril::gap {
namespace {

// Long beside the jitter of a position controller's stamps and readings, short beside a slow motion.
constexpr double kState_s = 0.25;
constexpr int kMostStates = 2000;   // of a set: more would cost memory and bring little
constexpr double kRounding = 1e-6;  // of stamps, in states

bool Read(const Eigen::MatrixXd& values) { return values.array().isFinite().any(); }

/// Of every disk, `width` columns each: the tip stands for the last where that has no readings of its own.
Eigen::MatrixXd OfDisks(const Eigen::MatrixXd& of_disks, const Eigen::MatrixXd& of_tip, Eigen::Index rows,
                        int width, int disks) {
  Eigen::MatrixXd all = Eigen::MatrixXd::Constant(rows, width * disks, kNoReading);
  if (of_disks.cols() == all.cols()) all = of_disks;
  if (of_tip.cols() == width && !Read(all.rightCols(width))) all.rightCols(width) = of_tip;
  return all;
}

/// S x 3 of a place, S x 4 of a turn.
Eigen::MatrixXd ReadingsOf(const Run& run, const PosturePoint& point, int disks) {
  const int width = point.turn ? 4 : 3;
  const Eigen::MatrixXd all =
      point.turn ? OfDisks(run.disk_quaternion, run.tip_quaternion, run.time_s.size(), width, disks)
                 : OfDisks(run.disks_m, run.tip_m, run.time_s.size(), width, disks);
  return all.middleCols(width * point.disk, width);
}

/// A rotation has two quaternions: the one nearer the one before, so that means are of one rotation.
void Align(Eigen::Ref<Eigen::MatrixXd> quaternions) {
  Eigen::RowVector4d before = Eigen::RowVector4d::Zero();
  for (Eigen::Index i = 0; i < quaternions.rows(); ++i) {
    if (!quaternions.row(i).allFinite()) continue;
    if (before.dot(quaternions.row(i)) < 0) quaternions.row(i) *= -1;
    before = quaternions.row(i);
  }
}

/// Mean of each column's readings in some rows; NaN without any.
Eigen::RowVectorXd MeanOf(const Eigen::MatrixXd& values, const std::vector<Eigen::Index>& rows) {
  Eigen::RowVectorXd mean(values.cols());
  for (Eigen::Index c = 0; c < values.cols(); ++c) {
    double sum = 0;
    int n = 0;
    for (const Eigen::Index i : rows) {
      if (std::isfinite(values(i, c))) sum += values(i, c), ++n;
    }
    mean[c] = n > 0 ? sum / n : kNoReading;
  }
  return mean;
}

/// What was not read is as it was before.
Eigen::MatrixXd WithoutHoles(Eigen::MatrixXd readings) {
  for (Eigen::Index j = 0; j < readings.cols(); ++j) {
    const auto column = readings.col(j);
    const auto first = std::find_if(column.begin(), column.end(), [](double x) { return std::isfinite(x); });
    double last = first == column.end() ? 0 : *first;
    for (Eigen::Index i = 0; i < readings.rows(); ++i) {
      if (std::isfinite(readings(i, j))) last = readings(i, j);
      readings(i, j) = last;
    }
  }
  return readings;
}

class Averaging {
 public:
  Averaging(const Run& run, const std::vector<PosturePoint>& points, int disks) : run_(run) {
    for (const PosturePoint& point : points) {
      Eigen::MatrixXd its = ReadingsOf(run, point, disks);
      if (point.turn) Align(its);
      readings_.conservativeResize(run.time_s.size(), readings_.cols() + its.cols());
      readings_.rightCols(its.cols()) = its;
      (point.turn ? turns_ : places_) += 1;
    }
  }

  States Result() {
    out_.run = run_.name;
    const Eigen::Index rows = run_.time_s.size();
    const auto state_of = [&](Eigen::Index row) {
      return std::floor((run_.time_s[row] - run_.time_s[0]) / kState_s + kRounding);
    };
    for (Eigen::Index first = 0; first < rows;) {
      Eigen::Index end = first + 1;
      while (end < rows && state_of(end) == state_of(first)) ++end;
      Add(first, end - first);
      first = end;
    }
    Fill();
    return std::move(out_);
  }

 private:
  void Add(Eigen::Index first, Eigen::Index count) {
    const std::vector<Eigen::Index> rows = RowsToAverage(first, count);
    const Eigen::RowVectorXd motor = MeanOf(run_.motor_position_rad, rows), seen = MeanOf(readings_, rows);
    if (!motor.allFinite() || !seen.allFinite()) {
      ++out_.lost;
      return;
    }
    time_.push_back(MeanOf(run_.time_s, rows)[0]);
    motor_.push_back(motor);
    seen_.push_back(seen);
    out_.rows.push_back({first, count});
  }

  /// Those in which everything was read, if there are any: means over different rows are of different times.
  std::vector<Eigen::Index> RowsToAverage(Eigen::Index first, Eigen::Index count) const {
    std::vector<Eigen::Index> all(static_cast<std::size_t>(count)), whole;
    std::iota(all.begin(), all.end(), first);
    std::copy_if(all.begin(), all.end(), std::back_inserter(whole), [&](Eigen::Index row) {
      return run_.motor_position_rad.row(row).allFinite() && readings_.row(row).allFinite();
    });
    return whole.empty() ? all : whole;
  }

  static Eigen::MatrixXd Stacked(const std::vector<Eigen::RowVectorXd>& rows) {
    Eigen::MatrixXd all(static_cast<Eigen::Index>(rows.size()), rows.empty() ? 0 : rows.front().size());
    for (std::size_t i = 0; i < rows.size(); ++i) all.row(static_cast<Eigen::Index>(i)) = rows[i];
    return all;
  }

  void Fill() {
    out_.time_s = Eigen::Map<const Eigen::VectorXd>(time_.data(), static_cast<Eigen::Index>(time_.size()));
    out_.motor_rad = Stacked(motor_);
    out_.path_s = run_.time_s;
    out_.path_rad = WithoutHoles(run_.motor_position_rad);
    const Eigen::MatrixXd seen = Stacked(seen_);
    out_.seen_m = Eigen::MatrixXd::Zero(seen.rows(), 3 * (places_ + turns_));
    out_.seen_m.leftCols(3 * places_) = seen.leftCols(3 * places_);
    out_.quaternion = seen.rightCols(4 * turns_);
    for (Eigen::Index t = 0; t < turns_; ++t) out_.quaternion.middleCols(4 * t, 4).rowwise().normalize();
  }

  const Run& run_;
  Eigen::MatrixXd readings_;  // of the points, places first
  Eigen::Index places_ = 0, turns_ = 0;
  std::vector<double> time_;
  std::vector<Eigen::RowVectorXd> motor_, seen_;
  States out_;
};

/// Every n-th state.
void Thin(States& run, int n) {
  std::vector<Eigen::Index> kept;
  for (Eigen::Index i = 0; i < run.time_s.size(); i += n) kept.push_back(i);
  run.time_s = run.time_s(kept).eval();
  for (Eigen::MatrixXd* values : {&run.motor_rad, &run.seen_m, &run.quaternion})
    *values = (*values)(kept, Eigen::all).eval();
  std::vector<States::Rows> rows;
  for (const Eigen::Index i : kept) {
    if (!run.rows.empty()) rows.push_back(run.rows[static_cast<std::size_t>(i)]);
  }
  run.rows = std::move(rows);
}

}  // namespace

Eigen::MatrixXd Postures::Stacked(Eigen::MatrixXd States::*values) const {
  Eigen::MatrixXd all(states(), (runs.front().*values).cols());
  Eigen::Index row = 0;
  for (const States& run : runs) {
    all.middleRows(row, (run.*values).rows()) = run.*values;
    row += (run.*values).rows();
  }
  return all;
}

Eigen::MatrixXd Postures::Moved() const {
  Eigen::MatrixXd all = Stacked(&States::seen_m);
  const Eigen::MatrixXd quaternions = Stacked(&States::quaternion);
  const auto at = [&](Eigen::Index state, Eigen::Index turn) {
    const Eigen::RowVector4d w = quaternions.row(state).segment<4>(4 * turn);
    return Eigen::Quaterniond(w[0], w[1], w[2], w[3]);
  };
  Eigen::Index turn = 0;
  for (std::size_t p = 0; p < points.size(); ++p) {
    if (!points[p].turn) continue;
    for (Eigen::Index i = 0; i < all.rows(); ++i) {
      const Eigen::Matrix3d from_first = (at(0, turn).conjugate() * at(i, turn)).toRotationMatrix();
      all.row(i).segment<3>(3 * static_cast<Eigen::Index>(p)) =
          lever_m * RotationVector(from_first).transpose();
    }
    ++turn;
  }
  return all.rowwise() - all.colwise().mean();
}

std::string Postures::ChannelName(Eigen::Index channel) const {
  const PosturePoint& point = points[static_cast<std::size_t>(channel / 3)];
  return fmt::format("{}disk {} {}{}", point.turn ? "turn of " : "", point.disk + 1,
                     point.turn ? "about " : "", "xyz"[channel % 3]);
}

Postures Postures::Thinned(int n) const {
  Postures thinned = *this;
  for (States& run : thinned.runs) Thin(run, n);
  return thinned;
}

void Postures::Keep(const std::vector<PosturePoint>& kept) {
  std::vector<Eigen::Index> channels, numbers;  // of all, and of the turns' quaternions
  Eigen::Index turn = 0;
  for (std::size_t p = 0; p < points.size(); ++p) {
    const bool stays = std::find(kept.begin(), kept.end(), points[p]) != kept.end();
    for (Eigen::Index i = 0; stays && i < 3; ++i) channels.push_back(3 * static_cast<Eigen::Index>(p) + i);
    for (Eigen::Index i = 0; stays && points[p].turn && i < 4; ++i) numbers.push_back(4 * turn + i);
    turn += points[p].turn;
  }
  for (States& run : runs) {
    run.seen_m = run.seen_m(Eigen::all, channels).eval();
    run.quaternion = run.quaternion(Eigen::all, numbers).eval();
  }
  points = kept;
}

std::vector<std::string> Postures::Lost() const {
  std::vector<std::string> lines;
  for (const States& run : runs) {
    if (run.lost == 0) continue;
    lines.push_back(fmt::format("run {}: {} of {} states without a reading of a motor or a disk", run.run,
                                run.lost, run.lost + run.time_s.size()));
  }
  return lines;
}

int Postures::states() const {
  int all = 0;
  for (const States& run : runs) all += static_cast<int>(run.time_s.size());
  return all;
}

bool ShowsPostures(const DataSet& set) {
  const int tendons = set.robot.body.tendons();
  return set.robot.actuation && std::all_of(set.runs.begin(), set.runs.end(), [&](const Run& run) {
           return run.time_s.size() > 1 && run.motor_position_rad.cols() == tendons &&
                  Read(run.motor_position_rad) &&
                  (Read(run.disks_m) || Read(run.tip_m) || Read(run.disk_quaternion) ||
                   Read(run.tip_quaternion)) &&
                  !Read(run.torque_actual_Nm) && !Read(run.torque_target_Nm) && !Read(run.tension_N);
         });
}

Postures PosturesOf(const std::vector<const Run*>& runs, const RobotParameters& robot) {
  Postures postures;
  const int disks = robot.body.disks();
  postures.lever_m = robot.body.length_m();
  for (const bool turn : {false, true}) {
    for (int d = 0; d < disks; ++d) {
      const PosturePoint point{turn, d};
      const bool seen = std::all_of(runs.begin(), runs.end(),
                                    [&](const Run* run) { return Read(ReadingsOf(*run, point, disks)); });
      if (seen) postures.points.push_back(point);
    }
  }
  if (postures.points.empty())
    throw std::runtime_error("no disk is seen in all of these runs; accepted: runs of the same markers");
  for (const Run* run : runs) {
    for (Eigen::Index j = 0; j < run->motor_position_rad.cols(); ++j) {
      if (!Read(run->motor_position_rad.col(j)))
        throw std::runtime_error(fmt::format(
            "run {}: no position of motor {}; accepted: readings of all {} motors (check the map's columns)",
            run->name, j + 1, run->motor_position_rad.cols()));
    }
    postures.runs.push_back(Averaging(*run, postures.points, disks).Result());
    if (postures.runs.back().time_s.size() == 0) {
      throw std::runtime_error(fmt::format(
          "run {}: motors and disks are nowhere read together; accepted: readings of the same times",
          run->name));
    }
  }
  const int every = (postures.states() + kMostStates - 1) / kMostStates;
  return postures.Thinned(std::max(1, every));
}

}  // namespace tendril::gap
