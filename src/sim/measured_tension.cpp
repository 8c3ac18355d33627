#include "measured_tension.h"

#include <utility>

namespace tendril::sim {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

class CellTensions final : public TensionSource {
 public:
  CellTensions(MatrixXd tension_N, Grid grid)
      : tension_(std::move(tension_N)), grid_(std::move(grid)), now_(At(tension_.cols())) {}
  void MoveTo(double time_s) noexcept override {
    grid_.MoveTo(time_s);
    for (Index j = 0; j < tension_.cols(); ++j) now_[At(j)] = grid_.Of(tension_.col(j).data());
  }
  void Evaluate(const double*, const double*, Tension* tension) const noexcept override {
    for (std::size_t j = 0; j < now_.size(); ++j) tension[j] = {now_[j], 0, 0};
  }
  void Commit(const double*, const double*) noexcept override {}

 private:
  static std::size_t At(Index j) { return static_cast<std::size_t>(j); }
  MatrixXd tension_;
  Grid grid_;
  std::vector<double> now_;
};

class PulleyTensions final : public TensionSource {
 public:
  PulleyTensions(PulleySignals signals, const std::vector<double>& presliding_m,
                 const std::vector<char>& no_motor, Grid grid)
      : signals_(std::move(signals)), grid_(std::move(grid)) {
    for (std::size_t j = 0; j < presliding_m.size(); ++j) {
      pulley_.push_back({model::PulleyPresliding(presliding_m[j]), 1e-3 * presliding_m[j]});
      if (j < no_motor.size() && no_motor[j] != 0) pulley_.back().of_body = 1;
    }
  }
  void MoveTo(double time_s) noexcept override {
    grid_.MoveTo(time_s);
    time_s_ = time_s;
    for (std::size_t j = 0; j < pulley_.size(); ++j) {
      const auto column = static_cast<Index>(j);
      Pulley& p = pulley_[j];
      p.spool_m = grid_.Of(signals_.spool_m.col(column).data());
      p.spool_rate_mps = grid_.Of(signals_.spool_rate_mps.col(column).data());
      p.middle_N = grid_.Of(signals_.middle_N.col(column).data());
      p.half_N = grid_.Of(signals_.half_N.col(column).data());
    }
  }
  void Evaluate(const double* shortening_m, const double* rate_mps,
                Tension* tension) const noexcept override {
    for (std::size_t j = 0; j < pulley_.size(); ++j) {
      const Pulley& p = pulley_[j];
      const Way way = WayOf(p, shortening_m[j], rate_mps[j]);
      const model::StopOperators<4>* memory = &p.memory;
      model::StopOperators<4> turned;
      if (way.turned) {
        turned = p.memory;
        turned.Commit(way.turn);
        memory = &turned;
      }
      const double slope =
          (memory->Peek(way.x + p.small_m) - memory->Peek(way.x - p.small_m)) / (2 * p.small_m);
      const double value = p.middle_N - memory->Peek(way.x) * p.half_N;
      tension[j] = value > 0 ? Tension{value, p.of_body * p.half_N * slope, 0} : Tension{};
    }
  }
  void Commit(const double* shortening_m, const double* rate_mps) noexcept override {
    for (std::size_t j = 0; j < pulley_.size(); ++j) {
      Pulley& p = pulley_[j];
      const Way way = WayOf(p, shortening_m[j], rate_mps[j]);
      if (way.turned) p.memory.Commit(way.turn);
      p.memory.Commit(way.x);
      p.slide_m = way.x;
      p.slide_rate_mps = p.Slid(p.spool_rate_mps, rate_mps[j]);
    }
    committed_s_ = time_s_;
  }

 private:
  struct Pulley {
    model::StopOperators<4> memory;
    double small_m = 0;
    double of_body = 0.5;  // of the body's shortening in the slide
    double Slid(double spool, double body) const noexcept { return 0.5 * spool + of_body * body; }
    double slide_m = 0, slide_rate_mps = 0;                            // committed
    double spool_m = 0, spool_rate_mps = 0, middle_N = 0, half_N = 0;  // now
  };
  Way WayOf(const Pulley& p, double shortening_m, double rate_mps) const noexcept {
    return WayTo(p.slide_m, p.slide_rate_mps, p.Slid(p.spool_m, shortening_m),
                 p.Slid(p.spool_rate_mps, rate_mps), time_s_ - committed_s_);
  }

  PulleySignals signals_;
  Grid grid_;
  std::vector<Pulley> pulley_;
  double time_s_ = 0, committed_s_ = 0;
};

class SpringTensions final : public TensionSource {
 public:
  SpringTensions(MatrixXd angle, MatrixXd velocity, std::vector<Drivetrain> drive, Grid grid)
      : angle_(std::move(angle)),
        velocity_(std::move(velocity)),
        grid_(std::move(grid)),
        drive_(std::move(drive)),
        motion_(drive_.size()) {}
  void MoveTo(double time_s) noexcept override {
    grid_.MoveTo(time_s);
    time_s_ = time_s;
    for (std::size_t j = 0; j < drive_.size(); ++j) {
      const auto column = static_cast<Index>(j);
      motion_[j].angle_rad = grid_.Of(angle_.col(column).data());
      motion_[j].velocity_radps = grid_.Of(velocity_.col(column).data());
    }
  }
  void Evaluate(const double* shortening_m, const double* rate_mps,
                Tension* tension) const noexcept override {
    for (std::size_t j = 0; j < drive_.size(); ++j) {
      const DrivetrainMotion motion = Moved(j, shortening_m, rate_mps);
      const DrivetrainForces forces = drive_[j].Evaluate(time_s_, motion);
      const DrivetrainLinear linear = drive_[j].Linearise(motion, forces, 1);
      const double ratio = forces.tension_motor_N > 0 ? forces.tension_base_N / forces.tension_motor_N : 0;
      tension[j] = {forces.tension_base_N, ratio * drive_[j].stiffness_Npm() - linear.base_slide,
                    ratio * drive_[j].damping_Nspm()};
    }
  }
  void Commit(const double* shortening_m, const double* rate_mps) noexcept override {
    for (std::size_t j = 0; j < drive_.size(); ++j) {
      drive_[j].Commit(time_s_, Moved(j, shortening_m, rate_mps));
    }
  }

 private:
  DrivetrainMotion Moved(std::size_t j, const double* shortening_m, const double* rate_mps) const noexcept {
    DrivetrainMotion motion = motion_[j];
    motion.shortening_m = shortening_m[j];
    motion.shortening_rate_mps = rate_mps[j];
    return motion;
  }

  MatrixXd angle_, velocity_;
  Grid grid_;
  std::vector<Drivetrain> drive_;
  std::vector<DrivetrainMotion> motion_;
  double time_s_ = 0;
};

class MixedTensions final : public TensionSource {
 public:
  MixedTensions(std::unique_ptr<TensionSource> cells, std::unique_ptr<TensionSource> springs, NoCell no_cell,
                Grid grid)
      : cells_(std::move(cells)),
        springs_(std::move(springs)),
        no_cell_(std::move(no_cell)),
        grid_(std::move(grid)),
        of_springs_(At(no_cell_.cols())) {}
  void MoveTo(double time_s) noexcept override {
    grid_.MoveTo(time_s);
    cells_->MoveTo(time_s);
    springs_->MoveTo(time_s);
  }
  void Evaluate(const double* shortening_m, const double* rate_mps,
                Tension* tension) const noexcept override {
    cells_->Evaluate(shortening_m, rate_mps, tension);
    const auto now = no_cell_.row(grid_.sample());
    if ((now.array() == 0).all()) return;
    springs_->Evaluate(shortening_m, rate_mps, of_springs_.data());
    for (Index j = 0; j < now.cols(); ++j) {
      if (now[j] != 0) tension[j] = of_springs_[At(j)];
    }
  }
  void Commit(const double* shortening_m, const double* rate_mps) noexcept override {
    cells_->Commit(shortening_m, rate_mps);
    springs_->Commit(shortening_m, rate_mps);
  }

 private:
  static std::size_t At(Index j) { return static_cast<std::size_t>(j); }
  std::unique_ptr<TensionSource> cells_, springs_;
  NoCell no_cell_;
  Grid grid_;
  mutable std::vector<Tension> of_springs_;
};

}  // namespace

std::unique_ptr<TensionSource> GivenTension(MatrixXd tension_N, Grid grid) {
  return std::make_unique<CellTensions>(std::move(tension_N), std::move(grid));
}
std::unique_ptr<TensionSource> PulleyTension(PulleySignals signals, const std::vector<double>& presliding_m,
                                             const std::vector<char>& no_motor, Grid grid) {
  return std::make_unique<PulleyTensions>(std::move(signals), presliding_m, no_motor, std::move(grid));
}
std::unique_ptr<TensionSource> SpringTension(MatrixXd angle_rad, MatrixXd velocity_radps,
                                             std::vector<Drivetrain> drive, Grid grid) {
  return std::make_unique<SpringTensions>(std::move(angle_rad), std::move(velocity_radps), std::move(drive),
                                          std::move(grid));
}
std::unique_ptr<TensionSource> MixedTension(std::unique_ptr<TensionSource> cells,
                                            std::unique_ptr<TensionSource> springs, NoCell no_cell,
                                            Grid grid) {
  return std::make_unique<MixedTensions>(std::move(cells), std::move(springs), std::move(no_cell),
                                         std::move(grid));
}

}  // namespace tendril::sim
