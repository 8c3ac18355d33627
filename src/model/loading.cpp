#include "tendril/model/loading.h"

#include "tendril/model/statics.h"

namespace tendril::model {

bool LoadingEndsAt(const Body& body, ConstVectorRef tension_N, ConstVectorRef q) {
  constexpr double kSame_rad = 1e-6;
  const Equilibrium loaded = SolveStatics(body, tension_N, Eigen::Vector3d::Zero());
  return loaded.result == StaticsResult::kConverged && !((loaded.q - q).cwiseAbs().maxCoeff() > kSame_rad);
}

}  // namespace tendril::model
