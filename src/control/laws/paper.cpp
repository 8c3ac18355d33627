// The paper's law: inverse dynamics of arcs of constant curvature, and the least tensions that give them.
#include "../report.h"
#include "tendril/control/arc_allocation.h"
#include "tendril/control/law.h"

namespace tendril::control {
namespace {

class PaperLaw final : public Law {
 public:
  explicit PaperLaw(const LawSetup& setup)
      : limits_(setup.limits), arcs_(setup.body, model::TendonPairs(setup.robot)) {}

  void Reset() noexcept override {}

  LawSolution Solve(const LawInput& cycle, CycleOutput& output) noexcept override {
    arcs_.AddFriction(cycle.pair_offset_N);
    const Status bound = arcs_.Step(limits_, output);
    if (cycle.controls_shape) Report(output, bound);
    return {.has_paths = !cycle.tension_commanded, .arc_shortening_m = output.displacement_desired_m};
  }

  void Archive(StateArchive&) noexcept override {}

 private:
  LimitParameters limits_;
  ArcAllocation arcs_;
};

}  // namespace

std::unique_ptr<Law> MakePaperLaw(const LawSetup& setup) { return std::make_unique<PaperLaw>(setup); }

}  // namespace tendril::control
