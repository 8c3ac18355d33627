// Runs of a robot whose motors' positions and disks were measured, as states: means over a time in which it
// hardly moves. Knows nothing of models.
#pragma once

#include <Eigen/Core>
#include <compare>
#include <string>
#include <vector>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// What three neighbouring channels are of one disk (from 0): its place, or how it is turned. A turn is a
/// rotation vector in the disk's axes, from the orientation that was measured, times Postures::lever_m: 0 as
/// measured, and in metres as all else.
struct PosturePoint {
  bool turn = false;
  int disk = 0;
  auto operator<=>(const PosturePoint&) const = default;
};

/// S states of one run, M tendons, C channels, T points that are turns.
struct States {
  std::string run;
  Eigen::VectorXd time_s;      // S
  Eigen::MatrixXd motor_rad;   // S x M
  Eigen::MatrixXd seen_m;      // S x C, places in the tracker's frame
  Eigen::MatrixXd quaternion;  // S x 4T: w, x, y, z, from the disk's axes to the tracker's
  int lost = 0;                // states left out: a motor or a disk was not read
  // How the motors came there: all their readings, those that are missing as the ones before, and which rows
  // each state is the mean of. Empty: only the states are known.
  Eigen::VectorXd path_s{};    // R
  Eigen::MatrixXd path_rad{};  // R x M
  struct Rows {
    Eigen::Index first = 0, count = 0;
  };
  std::vector<Rows> rows{};  // S
};

struct Postures {
  std::vector<PosturePoint> points;  // those that every run shows: places first, each kind by disk
  double lever_m = 0;                // that turns are multiplied by: the body's length
  std::vector<States> runs;

  int states() const;
  int channels() const { return 3 * static_cast<int>(points.size()); }
  std::string ChannelName(Eigen::Index channel) const;  // "disk 3 x", "turn of disk 3 about x"; from 1
  const char* UnitOf(Eigen::Index channel) const { return IsTurn(channel) ? "rad" : "m"; }
  /// What a value of a channel has to be divided by to be in that unit.
  double PerUnit(Eigen::Index channel) const { return IsTurn(channel) ? lever_m : 1; }
  bool IsTurn(Eigen::Index channel) const { return points[static_cast<std::size_t>(channel / 3)].turn; }
  /// S x C of all runs: every channel from its mean.
  Eigen::MatrixXd Moved() const;
  /// Every n-th state of each run.
  Postures Thinned(int n) const;
  /// Keeps these of its points only.
  void Keep(const std::vector<PosturePoint>& kept);
  /// A line each run that lost states.
  std::vector<std::string> Lost() const;
  /// One matrix of all runs, one below the other.
  Eigen::MatrixXd Stacked(Eigen::MatrixXd States::*values) const;
};

/// Every run has motor positions and disks or the tip, by place or orientation, and neither torques nor
/// tensions: the motors hold positions, and what they need for that was not recorded.
bool ShowsPostures(const DataSet& set);

/// Of some runs of a set of which ShowsPostures is true. Throws std::runtime_error where no disk is seen in
/// all of them, or no state is left.
Postures PosturesOf(const std::vector<const Run*>& runs, const RobotParameters& robot);

}  // namespace tendril::gap
