#include "tendril/control/arc_allocation.h"

namespace tendril::control {

Status ArcAllocation::Step(const LimitParameters& limits, CycleOutput& output) noexcept {
  const BendingReference& arcs = output.reference;
  const auto allocated = arcs_.Move(arcs.position_rad, arcs.velocity_radps, arcs.acceleration_radps2,
                                    limits.min_tension_N, limits.max_tension_base_N);
  output.reference_tip_W_m = body_.TipPose(arcs_.q()).p_WA;
  body_.TendonShortening(arcs_.q(), output.displacement_desired_m);
  output.generalised_force_Nm = arcs_.force_Nm();
  output.tension_desired_base_N = allocated.tension_N;
  return allocated.bound == Status::kLimitedTensionMin ? Status::kOk : allocated.bound;
}

}  // namespace tendril::control
