// The derived quantities of `tendril config check`, as YAML comments in columns.
#include <fmt/core.h>

#include <algorithm>
#include <string>

#include "tendril/daemon/file_check.h"
#include "tendril/model/bending_model.h"
#include "tendril/model/figures.h"

namespace tendril::daemon {
namespace {

constexpr std::size_t kFrequencies = 4;
constexpr double kNothing_m = 1e-9;

std::string Line(std::string_view what, const std::string& value) {
  return fmt::format("#   {:<20} {}\n", what, value);
}

std::string Millimetres(const std::optional<double>& length_m) {
  if (!length_m) return "none: it buckles";
  return fmt::format("{:.3g} mm", *length_m < kNothing_m ? 0 : 1e3 * *length_m);
}

bool HasPairs(const RobotParameters& robot) { return robot.actuation && !robot.actuation->pairs.empty(); }

std::string FullBend(const model::SectionFigures& s, const RobotParameters& robot) {
  const LimitParameters& limits = robot.limits;
  if (!s.full_bend_base_N)
    return HasPairs(robot) ? "not held: more than the pretension of the pairs gives"
                           : "not held at any tension";
  std::string text = fmt::format("{:.3g} N at the base ({:.0f} % of limits.max_tension_base_N)",
                                 *s.full_bend_base_N, 100 * *s.full_bend_base_N / limits.max_tension_base_N);
  if (s.full_bend_torque_Nm) {
    text += fmt::format(", {:.3g} N at the motor, whose torque is {:.3g} mN·m ({:.0f} % of rated)",
                        *s.full_bend_motor_N, 1e3 * *s.full_bend_torque_Nm, 100 * *s.full_bend_rated_share);
  }
  return text;
}

std::string FrequenciesText(const std::vector<double>& frequencies_Hz) {
  std::string text;
  for (std::size_t i = 0; i < std::min(kFrequencies, frequencies_Hz.size()); ++i)
    text += fmt::format("{}{:.3g}", i == 0 ? "" : ", ", frequencies_Hz[i]);
  return text.empty() ? "none: it buckles under its weight or pretension"
                      : text + " Hz, without damping, at rest under pretension";
}

}  // namespace

std::string FiguresComment(const RobotParameters& robot) {
  const model::Figures figures = model::FiguresOf(robot);
  std::string text = fmt::format("# derived quantities of {}:\n", robot.name);
  for (std::size_t k = 0; k < figures.sections.size(); ++k) {
    const model::SectionFigures& s = figures.sections[k];
    const std::string number = figures.sections.size() == 1 ? "" : fmt::format(" {}", k + 1);
    text +=
        Line("bending stiffness" + number, fmt::format("E I = {:.4g} N·m², over the section {:.4g} N·m/rad",
                                                       s.bending_stiffness_Nm2, s.stiffness_Nm));
    text += Line("full bend" + number,
                 fmt::format("{:g} rad: {}", robot.limits.max_bending_rad, FullBend(s, robot)));
  }
  text +=
      Line("sag under gravity", fmt::format("{} as mounted, {} held level, of {:.4g} mm of length",
                                            Millimetres(figures.sag_mounted_m),
                                            Millimetres(figures.sag_level_m), 1e3 * robot.body.length_m()));
  text += Line("natural frequencies", FrequenciesText(figures.frequencies_Hz));
  if (!robot.body.BendsOnly()) {
    const auto worst_m = model::WorstTipErrorOfBending(robot);
    text += Line(
        "bending-only model",
        worst_m
            ? fmt::format("its tip is up to {} off: each tendon in turn at {:g} N, the others at {:g} N",
                          Millimetres(worst_m), robot.limits.max_tension_base_N, robot.limits.min_tension_N)
            : "no equilibrium of this or that model under one tendon at limits.max_tension_base_N");
  }
  const std::string each =
      HasPairs(robot) ? fmt::format("in {} tendons", robot.body.tendons())
                      : fmt::format("({} x {:g} N)", robot.body.tendons(), robot.limits.min_tension_N);
  return text + Line("weight", fmt::format("{:.3g} N, against {:.3g} N of pretension {}", figures.weight_N,
                                           figures.pretension_N, each));
}

}  // namespace tendril::daemon
