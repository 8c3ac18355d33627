// The demo's samples.csv, for plots and other programs. Knows nothing of what is judged.
#pragma once

#include <Eigen/Core>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <vector>

#include "tendril/core/cycle.h"
#include "tendril/sim/plant.h"

namespace tendril::experiment {

class SampleWriter {
 public:
  /// `units` of the plant's body: the positions of their disks show the whole robot.
  SampleWriter(const std::filesystem::path& path, int sections, int tendons, int units);

  void Write(double t_s, const CycleRecord& record, const sim::Plant& plant,
             const Eigen::Vector3d& target_W_m);

 private:
  void WriteRow(double t_s, const CycleRecord& record, const sim::Plant& plant,
                const Eigen::Vector3d& target_W_m);

  struct Close {
    void operator()(std::FILE* f) const { std::fclose(f); }
  };
  std::filesystem::path path_;
  int sections_, tendons_;
  std::vector<model::Pose> disks_;
  std::unique_ptr<std::FILE, Close> file_;
};

}  // namespace tendril::experiment
