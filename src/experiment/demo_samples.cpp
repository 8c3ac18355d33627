#include "demo_samples.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <string>
#include <system_error>

namespace tendril::experiment {

SampleWriter::SampleWriter(const std::filesystem::path& path, int sections, int tendons, int units)
    : path_(path), sections_(sections), tendons_(tendons), disks_(static_cast<std::size_t>(units)) {
  file_.reset(std::fopen(path.c_str(), "w"));
  if (!file_)
    throw std::runtime_error(fmt::format("cannot write {}: {}", path.string(), std::strerror(errno)));
  std::string header =
      "t_s,mode,tip_target_x_m,tip_target_y_m,tip_target_z_m,tip_true_x_m,tip_true_y_m,tip_true_z_m,"
      "tip_estimate_x_m,tip_estimate_y_m,tip_estimate_z_m";
  for (int k = 1; k <= sections; ++k) {
    const std::string suffix = sections > 1 ? fmt::format("_{}", k) : "";
    for (const char* what : {"desired", "true", "estimate"}) {
      header += fmt::format(",us_{0}_rad{1},vs_{0}_rad{1}", what, suffix);
    }
  }
  for (int j = 1; j <= tendons; ++j) {
    for (const char* what :
         {"displacement_desired_m", "displacement_m", "displacement_true_m", "tension_desired_base_N",
          "tension_desired_motor_N", "tension_motor_true_N", "tension_base_true_N", "tension_measured_N",
          "torque_target_Nm", "torque_actual_Nm"}) {
      header += fmt::format(",{}_{}", what, j);
    }
  }
  for (std::size_t i = 1; i <= disks_.size(); ++i)
    header += fmt::format(",disk_x_m_{0},disk_y_m_{0},disk_z_m_{0}", i);
  fmt::print(file_.get(), "{}\n", header);
}

void SampleWriter::Write(double t_s, const CycleRecord& record, const sim::Plant& plant,
                         const Eigen::Vector3d& target_W_m) {
  try {
    WriteRow(t_s, record, plant, target_W_m);
  } catch (const std::system_error& e) {
    throw std::runtime_error(fmt::format("cannot write {}: {}; make room or choose another folder with --out",
                                         path_.string(), e.code().message()));
  }
}

void SampleWriter::WriteRow(double t_s, const CycleRecord& record, const sim::Plant& plant,
                            const Eigen::Vector3d& target_W_m) {
  const CycleOutput& o = record.output;
  const Eigen::Vector3d tip = plant.TipPose().p_WA;
  fmt::print(file_.get(), "{:.3f},{}", t_s, static_cast<int>(o.mode));
  for (const auto& p : {target_W_m, tip, o.tip_estimate_W_m}) {
    if (p.allFinite()) {
      fmt::print(file_.get(), ",{:.7g},{:.7g},{:.7g}", p.x(), p.y(), p.z());
    } else {
      fmt::print(file_.get(), ",,,");
    }
  }
  BendingVector bend(2 * sections_);
  plant.body().SumBending(plant.q(), bend);
  for (int k = 0; k < sections_; ++k) {
    for (const BendingVector& b : {o.reference.position_rad, bend, o.bending_estimate_rad}) {
      fmt::print(file_.get(), ",{:.7g},{:.7g}", b[2 * k], b[2 * k + 1]);
    }
  }
  for (int j = 0; j < tendons_; ++j) {
    const sim::TendonState& t = plant.tendon()[static_cast<std::size_t>(j)];
    fmt::print(file_.get(), ",{:.7g},{:.7g},{:.7g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g}",
               o.displacement_desired_m[j], o.displacement_m[j], t.body_shortening_m,
               o.tension_desired_base_N[j], o.tension_desired_motor_N[j], t.tension_motor_N, t.tension_base_N,
               o.tension_measured_N[j], o.torque_desired_Nm[j], o.torque_measured_Nm[j]);
  }
  plant.body().Poses(plant.q(), disks_);
  for (const model::Pose& disk : disks_)
    fmt::print(file_.get(), ",{:.6g},{:.6g},{:.6g}", disk.p_WA.x(), disk.p_WA.y(), disk.p_WA.z());
  fmt::print(file_.get(), "\n");
}

}  // namespace tendril::experiment
