#include "sampled.h"

namespace tendril::sim {

using Eigen::Index;
using Eigen::VectorXd;

bool Bridge(Eigen::Ref<VectorXd> values) {
  Index last = -1;
  for (Index i = 0; i < values.size(); ++i) {
    if (!std::isfinite(values[i])) continue;
    for (Index k = last + 1; k < i; ++k) {
      const double share = last < 0 ? 1 : static_cast<double>(k - last) / static_cast<double>(i - last);
      values[k] = last < 0 ? values[i] : values[last] + share * (values[i] - values[last]);
    }
    last = i;
  }
  if (last < 0) return values.size() == 0;
  values.tail(values.size() - 1 - last).setConstant(values[last]);
  return true;
}

void Differentiate(Eigen::Ref<const VectorXd> x, double step, Eigen::Ref<VectorXd> rate) {
  const Index s = x.size();
  for (Index i = 0; i < s; ++i) {
    if (i >= 2 && i + 2 < s) {
      rate[i] = (8 * (x[i + 1] - x[i - 1]) - (x[i + 2] - x[i - 2])) / (12 * step);
    } else {
      const Index a = std::max<Index>(0, i - 1), b = std::min(s - 1, i + 1);
      rate[i] = b > a ? (x[b] - x[a]) / (static_cast<double>(b - a) * step) : 0;
    }
  }
}

}  // namespace tendril::sim
