// The table of control laws. A new law is a file of this folder and a row here.
#include "tendril/control/law.h"

namespace tendril::control {

using LawFactory = std::unique_ptr<Law>(const LawSetup& setup);
LawFactory MakePaperLaw, MakeEquilibriumLaw;  // each in the file of its name

std::span<const LawRow> Laws() noexcept {
  static constexpr LawRow kLaws[] = {
      {.name = "paper", .feeds_forward = false, .make = MakePaperLaw},
      {.name = "equilibrium", .feeds_forward = true, .make = MakeEquilibriumLaw},
  };
  return kLaws;
}

}  // namespace tendril::control
