#include "motion.h"

#include <cmath>
#include <numbers>
#include <stdexcept>

namespace tendril::tools {
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
// rest. Abrupt stops would overshoot: a moving target is looked at one trajectory delay ahead.
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
  explicit Circle(const BodyParameters& body) {
    name_ = "circle";
    const double theta = kPi / 3, l = body.length_m();
    radius_m_ = l / theta * (1 - std::cos(theta));
    height_m_ = l / theta * std::sin(theta);
    const double turn_s = 2 * kPi / kOmega;
    judged_from_s_ = kLead_s;
    judged_until_s_ = kLead_s + turn_s;
    duration_s_ = turn_s + 2 * kLead_s;
    char text[120];
    std::snprintf(text, sizeof text, "tip circle of radius %.4f mm at z = %.4f mm, one revolution in %.0f s",
                  radius_m_ * 1e3, height_m_ * 1e3, turn_s);
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
  static constexpr double kOmega = kPi / 6, kLead_s = 1;

  // The judged revolution begins at angle 0, in full motion.
  std::pair<double, double> AngleAt(double t) const {
    const Lead at = RestToRest(t, duration_s_ - kLead_s, kLead_s);
    return {kOmega * (at.distance - kLead_s / 2), kOmega * at.speed};
  }

  double radius_m_, height_m_;
};

class PlanarBend final : public Motion {
 public:
  explicit PlanarBend(const BodyParameters& body) : body_(body), model_(body) {
    name_ = "planar";
    description_ = "bend in the xz plane from straight to 1.6 rad at 0.26 rad/s, and rest";
    bend_s_ = kEnd_rad / kRate_radps + kLead_s;
    judged_from_s_ = 0;
    judged_until_s_ = bend_s_ + kRest_s;
    duration_s_ = judged_until_s_;
  }

  Command At(double t) const override {
    const Lead at = RestToRest(t, kEnd_rad / kRate_radps, kLead_s);
    const double bend = kRate_radps * at.distance, rate = kRate_radps * at.speed;
    Command target;
    target.kind = CommandKind::kBending;
    target.bending_rad = Spread(body_, bend, 0);
    target.bending_rate_radps = Spread(body_, rate, 0);
    return target;
  }
  Eigen::Vector3d TipAt(double t) const override {
    Eigen::VectorXd q(model_.dof());
    model_.SpreadBending(At(t).bending_rad, q);
    return model_.TipPose(q).p_WA;
  }

 private:
  static constexpr double kEnd_rad = 1.6, kRate_radps = 0.26, kRest_s = 1, kLead_s = 0.5;
  BodyParameters body_;
  model::Body model_;
  double bend_s_;
};

}  // namespace

Command Motion::Start() const {
  Command start = At(0);
  start.tip_velocity_W_mps.setZero();
  start.bending_rate_radps.setZero();
  return start;
}

std::unique_ptr<Motion> MakeCircle(const BodyParameters& body) { return std::make_unique<Circle>(body); }
std::unique_ptr<Motion> MakePlanarBend(const BodyParameters& body) {
  return std::make_unique<PlanarBend>(body);
}

std::unique_ptr<Motion> MakeMotion(const std::string& name, const BodyParameters& body) {
  if (name == "circle") return MakeCircle(body);
  if (name == "planar") return MakePlanarBend(body);
  throw std::invalid_argument("no motion is called '" + name + "'; there are circle and planar");
}

}  // namespace tendril::tools
