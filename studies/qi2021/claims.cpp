#include "claims.h"

#include <algorithm>
#include <stdexcept>

#include "paper.h"

namespace tendril::qi2021 {
namespace {

// id, section, figure, what, says, paper, paper_value, unit, plot
const Claim kClaims[] = {
    {"eq31_bend", "5.2", "eq. 31", "bend on the circle is constant, pi/3",
     "On the circle of eq. 31 the robot is bent by a constant angle of pi/3.", "pi/3 = 1.0472 rad",
     kCircleBend_rad, "rad", "eq31"},
    {"eq31_length", "5.2", "eq. 31", "the robot is 90 mm long",
     "The robot that draws the circle of eq. 31 is 90 mm long.", "90 mm", 1e3 * kTextLength_m, "mm", "eq31"},
    {"eq31_rate", "5.2", "eq. 31", "the circle turns at 0.53 rad/s", "The bending plane turns at 0.53 rad/s.",
     "0.53 rad/s", kTextRate_radps, "rad/s", ""},
    {"3.1_sinusoid", "3.1", "Fig. 4a", "each unit's bend is a sinusoid",
     "Without tension each unit's bending angle varies as a sinusoid.", "one sinusoid", 1, "modes", "fig4"},
    {"3.1_fixed_value", "3.1", "Fig. 4", "about a fixed value, an equilibrium",
     "The angles, and with them the robot's shape, oscillate about a fixed equilibrium value.",
     "a fixed value", std::nullopt, "rad", "fig4"},
    {"3.1_beta", "3.1", "Fig. 4", "the bending plane's angle stays 0",
     "The rotation angle beta is 0 at all times.", "0 rad", 0, "rad", "fig4"},
    {"3.1_energy", "3.1", "", "total energy stays constant", "The system's total energy never changes.",
     "constant", 0, "relative", ""},
    {"3.2_convergence", "3.2", "Fig. 5", "the motion converges",
     "Under 5 N on tendon 1, from pi/12 a unit, the angles swing and converge to a stable position.",
     "converges", 0, "rad", "fig5"},
    {"3.2_equilibrium", "3.2", "Fig. 5b", "equilibrium at pi/6 a unit",
     "The robot's shape converges to the equilibrium with a bending angle of pi/6.", "pi/6 = 0.5236 rad",
     kPaperEquilibrium_rad, "rad", "fig5_readings"},
    {"3.2_order", "3.2", "Fig. 5a", "angles fall from base to tip",
     "From the first to the last unit the bending angles become smaller.", "fall", std::nullopt,
     "last / first", "fig5"},
    {"3.2_beta", "3.2", "Fig. 5", "the motion stays in one plane",
     "Under one tendon the robot moves in a plane and beta stays 0, although it starts at 0.001.", "0 rad", 0,
     "rad", ""},
    {"fig7_less_than_classic", "4", "Fig. 7", "improved law loses less than classic",
     "With nonlinear friction and bending stiffness a pulley loses less tension than the classic law says.",
     "less", std::nullopt, "of the classic loss", "fig7"},
    {"fig7_wrap", "4", "Fig. 7", "loss grows with the wrap",
     "The larger the wrap angle, the larger the loss.", "grows", std::nullopt, "least step", "fig7"},
    {"fig7_gentler", "4", "Fig. 7", "improved ratio changes more gently",
     "The improved model's tension ratio changes more gently with the wrap than the classic one.", "gentler",
     std::nullopt, "classic slope / ours", "fig7"},
    {"fig7_alpha", "4", "Fig. 7", "friction coefficient matters most",
     "The friction coefficient is the most important parameter of the transmission's efficiency.",
     "alpha first", std::nullopt, "change of ratio at pi", "fig7"},
    {"fig7_exponent", "4", "Fig. 7", "friction exponent beats bending stiffness",
     "Nonlinear friction influences the tension loss more than bending stiffness does.", "n before rho",
     std::nullopt, "effect n / effect rho", "fig7"},
    {"5.1_rate", "5.1", "Fig. 11", "the bend grows at 0.26 rad/s",
     "The robot bends in the plane at a constant rate of 0.26 rad/s.", "0.26 rad/s", kPlanarRate_radps,
     "rad/s", "fig11"},
    {"5.1_path", "5.1", "Fig. 11a", "the tip moves on an elliptic arc",
     "The tip's path in the plane is an arc of an ellipse.", "ellipse", 0, "mm", "fig11"},
    {"5.1_tendon1_only", "5.1", "Fig. 11c", "only tendon 1 carries load",
     "Only tendon 1 pulls; the other tendons' tensions are 0.", "0 N in the others", 0, "N", "fig11"},
    {"5.1_loss", "5.1", "Fig. 11d", "at 1.6 rad the loss is 1.26 N",
     "The deviation between theoretical and measured tension is largest at 1.6 rad: 1.26 N.", "1.26 N",
     kPlanarLoss_N, "N", "fig11"},
    {"5.1_grows", "5.1", "Fig. 11d", "the loss grows with the bend",
     "The tension loss grows with the bending angle and is largest at 1.6 rad.", "largest at 1.6 rad",
     kPlanarBend_rad, "rad", "fig11"},
    {"5.1_negligible", "5.1", "Fig. 11d", "1.26 N is small and may be neglected",
     "The deviation is a small share and can be neglected.", "negligible", std::nullopt,
     "of the needed tension", "fig11"},
    {"5.2_bend", "5.2", "Fig. 13b", "the rig's bend stays at pi/3",
     "The robot moves on the circle with a constant bending angle of pi/3.", "pi/3 = 1.0472 rad",
     kCircleBend_rad, "rad", "fig13"},
    {"5.2_loss", "5.2", "Fig. 13e", "mean loss on the circle is 0.42 N",
     "On the circle the tendons lose 0.42 N each on average.", "0.42 N", kCircleLoss_N, "N", "fig13"},
    {"5.2_theory_below_actual", "5.2", "Fig. 13d", "theory slightly below actual tension",
     "The theoretical tension is slightly smaller than the one applied (also conclusion 1).",
     "slightly below", 1, "share of the loaded time", "fig13"},
    {"5.2_negligible", "5.2", "Fig. 13e", "0.42 N is small and may be neglected",
     "The mean error of 0.42 N is small and can be neglected.", "negligible", std::nullopt,
     "of the mean needed tension", "fig13"},
    {"6_constant_curvature", "6", "", "the arc assumption is good enough",
     "The experiments confirm the constant-curvature assumption (conclusion 2).", "confirmed", std::nullopt,
     "mm", ""},
};

}  // namespace

std::span<const Claim> Claims() { return kClaims; }

const Claim& ClaimNamed(std::string_view id) {
  const auto found =
      std::find_if(std::begin(kClaims), std::end(kClaims), [&](const Claim& c) { return c.id == id; });
  if (found == std::end(kClaims)) throw std::logic_error("no claim " + std::string(id));
  return *found;
}

}  // namespace tendril::qi2021
