// Runs of a robot whose motors' positions and disks were measured, as states: means over a time in which it
// hardly moves. Knows nothing of models.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// S states of one run, M tendons, P disks.
struct States {
  std::string run;
  Eigen::VectorXd time_s;       // S
  Eigen::MatrixXd motor_rad;    // S x M
  Eigen::MatrixXd motor_radps;  // their mean speed there
  Eigen::MatrixXd disks_m;      // S x 3P, in the tracker's frame
  int lost = 0;                 // states left out: a motor or a disk was not read
};

struct Postures {
  std::vector<int> disks;  // P, from 0: those that every run shows
  std::vector<States> runs;

  int states() const;
  int channels() const { return 3 * static_cast<int>(disks.size()); }
  std::string ChannelName(Eigen::Index channel) const;  // "disk 3 x", counted from 1
  /// A line each run that lost states.
  std::vector<std::string> Lost() const;
  /// One matrix of all runs, one below the other.
  Eigen::MatrixXd Stacked(Eigen::MatrixXd States::*values) const;
};

/// Every run has motor positions and disks or the tip, and neither torques nor tensions: the motors hold
/// positions, and what they need for that was not recorded.
bool ShowsPostures(const DataSet& set);

/// Of some runs of a set of which ShowsPostures is true. Throws std::runtime_error where no disk is seen in
/// all of them, or no state is left.
Postures PosturesOf(const std::vector<const Run*>& runs, const RobotParameters& robot);

}  // namespace tendril::gap
