// Eq. 31, the circle's geometry. Computes with arcs only.
#include <Eigen/Core>
#include <cmath>

#include "figures.h"
#include "paper.h"
#include "tendril/model/body.h"
#include "tendril/model/inverse.h"

namespace tendril::qi2021 {
namespace {

using Eigen::Vector3d;
using model::Body;
using nlohmann::ordered_json;

// Largest bend that the inverse kinematics look at: beyond all of the paper's.
constexpr double kAnyBend_rad = 2.6;

Vector3d CircleTip(double t_s) {
  return {kCircleRadius_m * std::cos(kCircleRate_radps * t_s),
          kCircleRadius_m * std::sin(kCircleRate_radps * t_s), kCircleHeight_m};
}

/// The backbone, as the tips of shorter robots of the same curvature.
void PutBackbone(Series& series, const BodyParameters& parameters, const BendingVector& arc) {
  for (int i = 1; i <= 40; ++i) {
    BodyParameters part = parameters;
    const double share = i / 40.0;
    for (auto& s : part.sections) s.unit_length_m *= share;
    const Vector3d p = model::InverseKinematics(Body(part), kAnyBend_rad).Tip(share * arc);
    series.row().Put(std::round(1e3 * parameters.length_m())).Put(p.x()).Put(p.z()).EndRow();
  }
}

}  // namespace

void CircleGeometry(Study& study) {
  study.Begin("eq. 31: the circle's geometry");
  // Eq. 5 with atan2: the bend of an arc from its chord does not depend on its length.
  const double bend_rad = 2 * std::atan2(kCircleRadius_m, kCircleHeight_m);
  const double length_m = kCircleRadius_m * bend_rad / (1 - std::cos(bend_rad));

  ordered_json readings;
  double rate_radps = 0;
  Series series = study.OpenSeries("eq31", {"length_mm", "x_m", "z_m"});
  for (const char* file : {"robots/qi2021_60mm.yaml", "robots/qi2021_90mm.yaml"}) {
    const BodyParameters parameters = study.Robot(file).body;
    const Body body(parameters);
    const model::InverseKinematics ik(body, kAnyBend_rad);
    const auto at = [&](double t) { return ik.Solve(CircleTip(t), BendingVector::Zero(2)); };
    const auto start = at(0), later = at(1);
    BendingVector arc(2);
    arc << kCircleBend_rad, 0;
    const Vector3d own = ik.Tip(arc);
    PutBackbone(series, parameters, arc);
    readings[fmt::format("{:.0f} mm robot", 1e3 * parameters.length_m())] = {
        {"bend of the nearest tip [rad]", start.us_vs.norm()},
        {"distance to eq. 31 [mm]", 1e3 * start.distance_m},
        {"radius at pi/3 [mm]", 1e3 * own.x()},
        {"height at pi/3 [mm]", 1e3 * own.z()}};
    rate_radps = std::atan2(later.us_vs[1], later.us_vs[0]) - std::atan2(start.us_vs[1], start.us_vs[0]);
  }
  const bool bend_ok = Apart(bend_rad, kCircleBend_rad) < 1e-4;
  study.Find("eq31_bend", {.ours = fmt::format("{:.5f} rad", bend_rad),
                           .our_value = bend_rad,
                           .verdict = bend_ok ? Verdict::kConfirmed : Verdict::kDiffers,
                           .reason = "Radius and height of eq. 31 fix the bend whatever the length: theta = "
                                     "2 atan2(radius, height), which is eq. 5 without its 0/0 at beta = 0.",
                           .readings = readings});
  study.Find("eq31_length",
             {.ours = fmt::format("{:.4f} mm", 1e3 * length_m),
              .our_value = 1e3 * length_m,
              .verdict = Apart(length_m, kTextLength_m) < 0.01 ? Verdict::kConfirmed : Verdict::kDiffers,
              .reason = fmt::format(
                  "Radius times theta over (1 - cos theta) is the arc's length: eq. 31 belongs to a {:.0f} "
                  "mm robot. Table 1 (4 units of 22.5 mm) and section 5 say 90 mm; such a robot cannot come "
                  "nearer than {:.1f} mm to the circle.",
                  1e3 * length_m, readings["90 mm robot"]["distance to eq. 31 [mm]"].get<double>()),
              .readings = readings});
  study.Find(
      "eq31_rate",
      {.ours = fmt::format("{:.4f} rad/s", rate_radps),
       .our_value = rate_radps,
       .verdict = std::abs(rate_radps - kTextRate_radps) < 0.005 ? Verdict::kConfirmed : Verdict::kDiffers,
       .reason = fmt::format("Eq. 31 itself turns at pi/6 rad/s, which rounds to 0.52; the text's number is "
                             "{:.1f} % higher, one revolution in {:.2f} instead of {:.0f} s.",
                             100 * (kTextRate_radps / rate_radps - 1), 2 * kPi / kTextRate_radps,
                             2 * kPi / rate_radps)});
}

}  // namespace tendril::qi2021
