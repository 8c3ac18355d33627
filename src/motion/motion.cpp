#include "tendril/motion/motion.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <stdexcept>

#include "tendril/model/bending_model.h"
#include "tendril/model/held_directions.h"
#include "tendril/model/pull_cone.h"
#include "tendril/model/tendon_pairs.h"

namespace tendril::motion {
namespace {

constexpr double kPi = std::numbers::pi;

// Bending of the whole robot spread over its sections by length: one arc of constant curvature.
BendingVector Spread(const BodyParameters& body, double us, double vs) {
  BendingVector b(2 * static_cast<int>(body.sections.size()));
  for (std::size_t k = 0; k < body.sections.size(); ++k) {
    const double share = body.sections[k].units * body.sections[k].unit_length_m / body.length_m();
    b.segment<2>(2 * static_cast<int>(k)) << share * us, share * vs;
  }
  return b;
}

// From rest to a constant speed 1 over `lead` seconds as a raised cosine: distance and speed t seconds after
// rest. Abrupt stops would overshoot, because a moving target is extrapolated by one trajectory delay.
struct Lead {
  double distance, speed;
};
Lead LeadAt(double t, double lead) {
  return {0.5 * (t - lead / kPi * std::sin(kPi * t / lead)), 0.5 * (1 - std::cos(kPi * t / lead))};
}

// Rest to rest over a distance at unit speed with a lead-in and a lead-out; takes distance + lead seconds.
Lead RestToRest(double t, double distance, double lead) {
  const double end = distance + lead;
  if (t <= 0) return {0, 0};
  if (t < lead) return LeadAt(t, lead);
  if (t <= distance) return {t - lead / 2, 1};
  const Lead left = LeadAt(std::max(0.0, end - t), lead);
  return {distance - left.distance, left.speed};
}

class Circle final : public Motion {
 public:
  Circle(const BodyParameters& body, const char* name, double omega_radps, int turns)
      : omega_radps_(omega_radps) {
    name_ = name;
    const double theta = kPi / 3, l = body.length_m();
    radius_m_ = l / theta * (1 - std::cos(theta));
    height_m_ = l / theta * std::sin(theta);
    const double turn_s = 2 * kPi / omega_radps_;
    judged_from_s_ = kLead_s;
    judged_until_s_ = kLead_s + turns * turn_s;
    duration_s_ = turns * turn_s + 2 * kLead_s;
    char text[120];
    std::snprintf(text, sizeof text, "tip circle of radius %.4f mm at z = %.4f mm, %s in %.0f s",
                  radius_m_ * 1e3, height_m_ * 1e3, turns == 1 ? "one revolution" : "a revolution", turn_s);
    description_ = text;
  }

  Command At(double t) const override {
    const auto [angle, rate] = AngleAt(t);
    Command target;
    target.kind = CommandKind::kTip;
    target.tip_W_m = {radius_m_ * std::cos(angle), radius_m_ * std::sin(angle), height_m_};
    target.tip_velocity_W_mps = radius_m_ * rate * Eigen::Vector3d(-std::sin(angle), std::cos(angle), 0);
    return target;
  }
  Eigen::Vector3d TipAt(double t) const override { return At(t).tip_W_m; }

 private:
  static constexpr double kLead_s = 1;

  // The evaluated revolution begins at angle 0, at full speed.
  std::pair<double, double> AngleAt(double t) const {
    const Lead at = RestToRest(t, duration_s_ - kLead_s, kLead_s);
    return {omega_radps_ * (at.distance - kLead_s / 2), omega_radps_ * at.speed};
  }

  double omega_radps_, radius_m_, height_m_;
};

// A tip path (x, y) on the surface reached by arcs of equal bend: z follows.
class OnArcs : public Motion {
 public:
  explicit OnArcs(const BodyParameters& body) : length_m_(body.length_m()) {}
  Eigen::Vector3d TipAt(double t) const override { return At(t).tip_W_m; }

 protected:
  /// Distance of the tip from the z axis at a bend.
  double RadiusOf(double theta) const { return length_m_ * (1 - std::cos(theta)) / theta; }
  Command TargetAt(const Eigen::Vector2d& at_m, const Eigen::Vector2d& velocity_mps) const {
    const double radius_m = at_m.norm();
    // rho(theta) = l (1 - cos theta) / theta rises up to theta = 2.33; Newton from its slope at zero.
    double theta = std::min(2.0, 2 * radius_m / length_m_), slope = 0;
    for (int i = 0; i < 50; ++i) {
      const bool small = theta < 1e-4;
      slope = small ? 0.5 * length_m_
                    : length_m_ * (std::sin(theta) / theta - (1 - std::cos(theta)) / (theta * theta));
      const double miss = (small ? 0.5 * length_m_ * theta : RadiusOf(theta)) - radius_m;
      if (std::abs(miss) < 1e-15) break;
      theta -= miss / slope;
    }
    const double height_m =
        theta < 1e-4 ? length_m_ * (1 - theta * theta / 6) : length_m_ * std::sin(theta) / theta;
    const double fall = theta < 1e-4
                            ? -length_m_ * theta / 3
                            : length_m_ * (std::cos(theta) / theta - std::sin(theta) / (theta * theta));
    const double radius_rate = radius_m > 0 ? at_m.dot(velocity_mps) / radius_m : 0;
    Command target;
    target.kind = CommandKind::kTip;
    target.tip_W_m = {at_m.x(), at_m.y(), height_m};
    target.tip_velocity_W_mps = {velocity_mps.x(), velocity_mps.y(), fall / slope * radius_rate};
    return target;
  }

  double length_m_;
};

// From the middle of one side round to it again; the tip comes to rest in each corner, which a path with
// corners requires.
class Square final : public OnArcs {
 public:
  explicit Square(const BodyParameters& body) : OnArcs(body) {
    name_ = "square";
    half_m_ = RadiusOf(kPi / 3) / std::sqrt(2.0);
    side_s_ = kSide_s + kLead_s;
    duration_s_ = judged_until_s_ = 4 * side_s_ + kRest_s;
    judged_from_s_ = 0;
    char text[120];
    std::snprintf(text, sizeof text, "tip square of %.2f mm a side, %.0f s a side, at rest in each corner",
                  2e3 * half_m_, kSide_s);
    description_ = text;
  }

  Command At(double t) const override {
    const int side = std::clamp(static_cast<int>(t / side_s_), 0, 3);
    const Lead at = RestToRest(std::min(t - side * side_s_, side_s_), kSide_s, kLead_s);
    const double angle = side * kPi / 2;
    const Eigen::Vector2d along(-std::sin(angle), std::cos(angle)),
        corner(std::cos(angle) + std::sin(angle), std::sin(angle) - std::cos(angle));
    const double speed = 2 * half_m_ / kSide_s;
    return TargetAt(half_m_ * corner + speed * at.distance * along, speed * at.speed * along);
  }

 private:
  static constexpr double kSide_s = 2, kLead_s = 0.3, kRest_s = 0.5;
  double half_m_, side_s_;
};

// Outwards and back: the tip turns, and rises and falls with its distance from the axis.
class Spiral final : public OnArcs {
 public:
  explicit Spiral(const BodyParameters& body) : OnArcs(body) {
    name_ = "spiral";
    judged_from_s_ = kLead_s;
    judged_until_s_ = kLead_s + kTurns * kTurn_s;
    duration_s_ = judged_until_s_ + kLead_s;
    char text[120];
    std::snprintf(text, sizeof text, "tip spiral out to a bend of %.2f rad and back, %d turns of %.0f s",
                  kBend_rad, kTurns, kTurn_s);
    description_ = text;
  }

  Command At(double t) const override {
    const Lead at = RestToRest(t, duration_s_ - kLead_s, kLead_s);
    const double whole = duration_s_ - kLead_s;
    const double angle = 2 * kPi / kTurn_s * (at.distance - kLead_s / 2), rate = 2 * kPi / kTurn_s * at.speed;
    const double outer_m = RadiusOf(kBend_rad), phase = 2 * kPi * at.distance / whole;
    const double radius_m = outer_m * (0.55 - 0.45 * std::cos(phase));
    const double radius_rate = outer_m * 0.45 * std::sin(phase) * 2 * kPi / whole * at.speed;
    const Eigen::Vector2d out(std::cos(angle), std::sin(angle)), round(-std::sin(angle), std::cos(angle));
    return TargetAt(radius_m * out, radius_rate * out + radius_m * rate * round);
  }

 private:
  static constexpr double kTurn_s = 3, kLead_s = 1, kBend_rad = 1.2;
  static constexpr int kTurns = 4;
};

class PlanarBend final : public Motion {
 public:
  explicit PlanarBend(const RobotParameters& robot)
      : model_(model::BendingModel(robot.body)),
        per_rad_(Spread(robot.body, 1, 0)),
        start_rad_(BendingVector::Zero(per_rad_.size())) {
    name_ = "planar";
    description_ = "bend in the xz plane from straight to 1.6 rad at 0.26 rad/s, and rest";
    if (!model::PullsEveryWay(robot.body)) TurnIntoHeld(robot);
    bend_s_ = way_rad_ / kRate_radps + kLead_s;
    judged_from_s_ = 0;
    judged_until_s_ = bend_s_ + kRest_s;
    duration_s_ = judged_until_s_;
  }

  Command At(double t) const override {
    const Lead at = RestToRest(t, way_rad_ / kRate_radps, kLead_s);
    const double bend = kRate_radps * at.distance, rate = kRate_radps * at.speed;
    Command target;
    target.kind = CommandKind::kBending;
    target.bending_rad = start_rad_ + bend * per_rad_;
    target.bending_rate_radps = rate * per_rad_;
    return target;
  }
  Eigen::Vector3d TipAt(double t) const override {
    Eigen::VectorXd q(model_.dof());
    model_.SpreadBending(At(t).bending_rad, q);
    return model_.TipPose(q).p_WA;
  }

 private:
  static constexpr double kEnd_rad = 1.6, kRate_radps = 0.26, kRest_s = 1, kLead_s = 0.5;

  // Bends each section to its share, towards the first direction that its tendons hold.
  void TurnIntoHeld(const RobotParameters& robot) {
    model_.SumBending(model::RestShape(model_, model::RestTensions_N(robot)), start_rad_);
    BendingVector end_rad = kEnd_rad * per_rad_;
    for (int k = 0; k < model_.sections(); ++k) {
      const model::PullCone cone = model::PullConeOf(robot.body, k);
      if (cone.kind == model::PullCone::Kind::kPlane) continue;
      const double bend = end_rad.segment<2>(2 * k).norm();
      end_rad.segment<2>(2 * k) << bend * std::cos(cone.from_rad), bend * std::sin(cone.from_rad);
    }
    way_rad_ = 0;
    for (int k = 0; k < model_.sections(); ++k) way_rad_ += (end_rad - start_rad_).segment<2>(2 * k).norm();
    per_rad_ = (end_rad - start_rad_) / way_rad_;
    description_ = "bend to 1.6 rad at 0.26 rad/s, and rest: " + model::HeldDirections(robot.body);
  }

  model::Body model_;
  BendingVector per_rad_, start_rad_;  // per bend of the whole robot; initial bend
  double way_rad_ = kEnd_rad, bend_s_;
};

// Motions that need every bending direction.
std::unique_ptr<Motion> MakeRound(const std::string& name, const BodyParameters& body) {
  if (name == "circle") return MakeCircle(body);
  if (name == "fast_circle") return std::make_unique<Circle>(body, "fast_circle", 2 * kPi, 5);
  if (name == "square") return std::make_unique<Square>(body);
  if (name == "spiral") return std::make_unique<Spiral>(body);
  throw std::invalid_argument("there is no motion '" + name +
                              "'; accepted: circle, planar, fast_circle, square, spiral");
}

}  // namespace

Command Motion::Start() const { return SentAhead(-1, 0, 0); }

Command Motion::SentAhead(double t_s, double ahead_s, double extrapolates_s) const {
  const double at_s = t_s + ahead_s;
  Command target = At(std::clamp(at_s, 0.0, duration_s_));
  if (at_s < 0 || at_s >= duration_s_) {
    target.tip_velocity_W_mps.setZero();
    target.bending_rate_radps.setZero();
  }
  target.tip_W_m -= extrapolates_s * target.tip_velocity_W_mps;
  if (target.bending_rate_radps.size() > 0) target.bending_rad -= extrapolates_s * target.bending_rate_radps;
  return target;
}

std::unique_ptr<Motion> MakeCircle(const BodyParameters& body) {
  return std::make_unique<Circle>(body, "circle", kPi / 6, 1);
}
std::unique_ptr<Motion> MakePlanarBend(const RobotParameters& robot) {
  return std::make_unique<PlanarBend>(robot);
}

std::unique_ptr<Motion> MakeMotion(const std::string& name, const RobotParameters& robot) {
  if (name == "planar") return MakePlanarBend(robot);
  std::unique_ptr<Motion> motion = MakeRound(name, robot.body);
  if (const std::string held = model::HeldDirections(robot.body); !held.empty()) {
    throw std::invalid_argument("the motion '" + name + "' bends every way, and of robot '" + robot.name +
                                "' " + held + "; accepted: planar");
  }
  return motion;
}

}  // namespace tendril::motion
