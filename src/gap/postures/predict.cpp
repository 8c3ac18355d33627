// Equilibria state by state, each from the one before; slopes by the implicit function theorem.
#include "predict.h"

#include <Eigen/Dense>
#include <algorithm>
#include <memory>
#include <stdexcept>

#include "../rotation.h"
#include "motor_path.h"
#include "tendril/core/parallel.h"
#include "tendril/model/body.h"
#include "tendril/model/capstan.h"
#include "tendril/model/held_statics.h"
#include "tendril/sim/effects.h"

namespace tendril::gap {
namespace {

constexpr double kStep = 1e-4;  // of a number: exponents, radians, or metres over a length
// Pull over which a tendon goes slack, of its distance from the backbone in the file.
constexpr double kSlackWidth = 0.01;
constexpr int kPieces = 8;  // of the states, each solved in one piece

/// A robot ready to be solved.
class Solver {
 public:
  /// `like`: another robot in the same states, whose motors and tendons may have moved as these; nullptr:
  /// none.
  Solver(PostureRobot robot, const Postures& postures, const Solver* like)
      : robot_(std::move(robot)),
        body_(robot_.robot.body),
        R_(Rotation(robot_.turn_rad)),
        travel_(body_.tendons()),
        stiffness_(body_.tendons()),
        presliding_(body_.tendons()),
        loss_(body_.tendons()) {
    for (int j = 0; j < body_.tendons(); ++j) {
      const auto& drive = robot_.robot.actuation->tendons[static_cast<std::size_t>(j)];
      travel_[j] = drive.SpoolTravelPerMotorRad();
      stiffness_[j] = drive.tendon.stiffness_Npm;
      presliding_[j] = drive.transmission.presliding_m;
      loss_[j] = model::CapstanLogRatio(drive.transmission.pulleys, robot_.robot.RestTension_N(j));
    }
    const bool same_path = like != nullptr && like->travel_ == travel_ && like->presliding_ == presliding_;
    const bool same_time = like != nullptr && like->robot_.motor_lag_s == robot_.motor_lag_s &&
                           like->robot_.clock_drift == robot_.clock_drift;
    const auto shared = [](Eigen::MatrixXd values) {
      return std::make_shared<const Eigen::MatrixXd>(std::move(values));
    };
    for (std::size_t r = 0; r < postures.runs.size(); ++r) {
      const States& run = postures.runs[r];
      sliding_.push_back(same_path ? like->sliding_[r] : shared(SlidingOf(run, travel_, presliding_)));
      angle_.push_back(same_time ? like->angle_[r]
                                 : shared(AnglesBefore(run, robot_.motor_lag_s, robot_.clock_drift)));
    }
  }
  Solver(const Solver&) = delete;

  const model::Body& body() const { return body_; }
  /// ln of what friction takes of each tendon's tension, M entries. `run`: its number in the postures.
  Eigen::VectorXd Loss(std::size_t run, Eigen::Index state) const {
    return loss_.cwiseProduct(sliding_[run]->row(state).transpose());
  }
  model::HeldStatics Statics() const { return {body_, stiffness_, robot_.slack_width_m}; }
  Eigen::VectorXd Pull(std::size_t run, Eigen::Index state) const {
    return travel_.cwiseProduct(angle_[run]->row(state).transpose()) + robot_.zero_m;
  }
  /// As seen in a state that has the shape q.
  Eigen::RowVectorXd Channels(const Eigen::VectorXd& q, const Postures& postures, const States& run,
                              Eigen::Index state, std::vector<model::Pose>& poses) const {
    poses.resize(static_cast<std::size_t>(body_.units()));
    body_.Poses(q, poses);
    Eigen::RowVectorXd seen(postures.channels());
    Eigen::Index turn = 0;
    for (std::size_t p = 0; p < postures.points.size(); ++p) {
      const PosturePoint& point = postures.points[p];
      const model::Pose& end = poses[static_cast<std::size_t>(body_.disk_unit(point.disk))];
      auto its = seen.segment<3>(3 * static_cast<Eigen::Index>(p));
      if (point.turn) {
        const Eigen::RowVector4d w = run.quaternion.row(state).segment<4>(4 * turn++);
        its = postures.lever_m *
              Turn(Eigen::Quaterniond(w[0], w[1], w[2], w[3]), end.R_WA, point.disk).transpose();
      } else {
        its = (R_ * end.p_WA + robot_.shift_m).transpose();
      }
    }
    return seen;
  }

 private:
  /// From a measured orientation to that of a disk with this R, in the sensor's axes.
  Eigen::Vector3d Turn(const Eigen::Quaterniond& measured, const Eigen::Matrix3d& R_disk, int disk) const {
    const auto mount = robot_.mount_rad.find(disk);
    const Eigen::Matrix3d R_sensor =
        mount == robot_.mount_rad.end() ? R_disk : Eigen::Matrix3d(R_disk * Rotation(mount->second));
    return RotationVector(measured.conjugate().toRotationMatrix() * R_ * R_sensor);
  }

  PostureRobot robot_;
  model::Body body_;
  Eigen::Matrix3d R_;
  Eigen::VectorXd travel_, stiffness_, presliding_, loss_;
  std::vector<std::shared_ptr<const Eigen::MatrixXd>> sliding_, angle_;  // by run, S x M
};

/// Some consecutive states of one run.
struct Piece {
  std::size_t run;                 // of the postures
  Eigen::Index first, count, row;  // of the run's states; row of the first in the result
};

std::vector<Piece> PiecesOf(const Postures& postures) {
  std::vector<Piece> pieces;
  Eigen::Index row = 0;
  for (std::size_t r = 0; r < postures.runs.size(); ++r) {
    const Eigen::Index states = postures.runs[r].time_s.size();
    const Eigen::Index longest = std::max<Eigen::Index>(1, (states + kPieces - 1) / kPieces);
    for (Eigen::Index first = 0; first < states; first += longest) {
      const Eigen::Index count = std::min(longest, states - first);
      pieces.push_back({r, first, count, row + first});
    }
    row += states;
  }
  return pieces;
}

class Predicting {
 public:
  Predicting(const Solver& solver, const std::vector<std::unique_ptr<Solver>>& moved,
             const Postures& postures, Predicted& out)
      : solver_(solver),
        moved_(moved),
        postures_(postures),
        out_(out),
        statics_(solver.Statics()),
        q_(Eigen::VectorXd::Zero(solver.body().dof())),
        force_(solver.body().dof()) {
    for (const auto& other : moved) moved_statics_.push_back(other->Statics());
  }

  /// The number of states without an equilibrium.
  int Run(const Piece& piece) {
    int unsolved = 0;
    const States& run = postures_.runs[piece.run];
    statics_.SetLoss(solver_.Loss(piece.run, piece.first));
    FromStraight(solver_.Pull(piece.run, piece.first));
    for (Eigen::Index i = 0; i < piece.count; ++i) {
      const Eigen::VectorXd pull = solver_.Pull(piece.run, piece.first + i);
      statics_.SetLoss(solver_.Loss(piece.run, piece.first + i));
      const Eigen::VectorXd before = q_;
      bool solved = true;
      if (!statics_.Solve(pull, q_)) {
        FromStraight(pull);
        if (!statics_.Solve(pull, q_)) {
          ++unsolved;
          solved = false;
          q_ = before;
        }
      }
      out_.channels_m.row(piece.row + i) = Channels(solver_, run, piece.first + i, q_);
      if (solved) {
        Slopes(piece.run, piece.first + i, piece.row + i, pull);
      } else {
        for (Eigen::MatrixXd& slope : out_.slopes) slope.row(piece.row + i).setZero();
      }
    }
    return unsolved;
  }

 private:
  Eigen::RowVectorXd Channels(const Solver& solver, const States& run, Eigen::Index state,
                              const Eigen::VectorXd& q) {
    return solver.Channels(q, postures_, run, state, poses_);
  }

  /// In steps, so that the branch is the one from the straight robot.
  void FromStraight(const Eigen::VectorXd& pull) {
    q_.setZero();
    for (const double share : {0.25, 0.5, 0.75}) statics_.Solve(share * pull, q_);
    if (!q_.allFinite()) q_.setZero();
  }

  void Slopes(std::size_t of, Eigen::Index state, Eigen::Index row, const Eigen::VectorXd& pull) {
    constexpr double kDisplaced = 1e-6;  // of a coordinate
    if (moved_.empty()) return;
    const States& run = postures_.runs[of];
    statics_.Residual(pull, q_, force_);
    const Eigen::VectorXd here = force_;
    const Eigen::RowVectorXd at = out_.channels_m.row(row);
    Eigen::MatrixXd by_q(at.size(), q_.size());
    for (Eigen::Index i = 0; i < q_.size(); ++i) {
      Eigen::VectorXd displaced = q_;
      displaced[i] += kDisplaced;
      by_q.col(i) = (Channels(solver_, run, state, displaced) - at).transpose() / kDisplaced;
    }
    const auto& tangent = statics_.Tangent(pull, q_);
    for (std::size_t p = 0; p < moved_.size(); ++p) {
      moved_statics_[p].SetLoss(moved_[p]->Loss(of, state));
      moved_statics_[p].Residual(moved_[p]->Pull(of, state), q_, force_);
      const Eigen::VectorXd dq = -tangent.solve((force_ - here) / kStep);
      const Eigen::RowVectorXd directly = (Channels(*moved_[p], run, state, q_) - at) / kStep;
      out_.slopes[p].row(row) = directly + (by_q * dq).transpose();
    }
  }

  const Solver& solver_;
  const std::vector<std::unique_ptr<Solver>>& moved_;
  const Postures& postures_;
  Predicted& out_;
  model::HeldStatics statics_;
  std::vector<model::HeldStatics> moved_statics_;
  Eigen::VectorXd q_, force_;
  std::vector<model::Pose> poses_;
};

}  // namespace

PostureRobot PostureRobot::Of(const RobotParameters& robot) {
  PostureRobot out;
  const sim::TrackerPlacement tracker = sim::PlacementOfTracker(robot);
  out.turn_rad = RotationVector(tracker.R);
  out.shift_m = tracker.offset_m;
  out.robot = sim::FoldEffects(robot);
  out.slack_width_m = kSlackWidth * robot.body.largest_hole_m();
  const auto& tendons = out.robot.actuation->tendons;
  out.zero_m.resize(static_cast<Eigen::Index>(tendons.size()));
  for (std::size_t j = 0; j < tendons.size(); ++j) {
    out.zero_m[static_cast<Eigen::Index>(j)] =
        robot.RestTension_N(static_cast<int>(j)) / tendons[j].tendon.stiffness_Npm;
  }
  for (const EffectSetting& setting : out.robot.effects) {
    const sim::Effect& effect = *sim::FindEffect(setting.name);
    if (effect.zero)
      MoveZero(out, effect, sim::ParseTarget(effect, setting.where, robot), setting.values.front().second);
  }
  return out;
}

void MoveZero(PostureRobot& robot, const sim::Effect& effect, sim::Target tendon, double value) {
  const bool angle = effect.parameters.front().name == "rad";
  const ActuationParameters& actuation = *robot.robot.actuation;
  for (int j = 0; j < robot.zero_m.size(); ++j) {
    // A motor turns both tendons of a pair.
    const TendonPair* pair = angle ? actuation.PairOf(j) : nullptr;
    const bool second = pair != nullptr && pair->second == j;
    if (tendon && *tendon != (second ? pair->first : j)) continue;
    const double travel_m = actuation.tendons[static_cast<std::size_t>(j)].SpoolTravelPerMotorRad();
    robot.zero_m[j] -= value * (angle ? second ? -travel_m : travel_m : 1);
  }
}

Predicted Predict(const RobotAt& robot_at, const Eigen::VectorXd& x, int slopes, const Postures& postures,
                  int threads) {
  const Solver solver(robot_at(x), postures, nullptr);
  std::vector<std::unique_ptr<Solver>> moved;
  for (int p = 0; p < slopes; ++p) {
    Eigen::VectorXd at = x;
    at[p] += kStep;
    moved.push_back(std::make_unique<Solver>(robot_at(at), postures, &solver));
    if (moved.back()->body().dof() != solver.body().dof())
      throw std::invalid_argument("a number that gives the body other strains has no slope");
  }
  Predicted out;
  out.channels_m.resize(postures.states(), postures.channels());
  out.slopes.assign(moved.size(), Eigen::MatrixXd(postures.states(), postures.channels()));
  const std::vector<Piece> pieces = PiecesOf(postures);
  std::vector<int> unsolved(pieces.size());
  ParallelFor(static_cast<int>(pieces.size()), threads, [&](int i) {
    const auto k = static_cast<std::size_t>(i);
    unsolved[k] = Predicting(solver, moved, postures, out).Run(pieces[k]);
  });
  for (const int n : unsolved) out.unsolved += n;
  return out;
}

}  // namespace tendril::gap
