// Local polynomial and adaptive mean; see the header.
#include "smoothing.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace tendril::gap {
namespace {

constexpr int kWidestSmoothing = 150;  // samples on either side, for a cell's reading at rest

}  // namespace

LocalPolynomial::LocalPolynomial(int half_width) : half(half_width) {
  const int n = 2 * half + 1;
  const int degree = std::min(4, n - 1);
  Eigen::MatrixXd powers(n, degree + 1);
  for (int i = 0; i < n; ++i) {
    for (int d = 0; d <= degree; ++d)
      powers(i, d) = std::pow((i - half) / static_cast<double>(std::max(half, 1)), d);
  }
  const Eigen::MatrixXd solve = (powers.transpose() * powers).ldlt().solve(powers.transpose());
  const double scale = std::max(half, 1);
  value = solve.row(0);
  first = degree >= 1 ? Eigen::RowVectorXd(solve.row(1) / scale) : Eigen::RowVectorXd::Zero(n);
  second = degree >= 2 ? Eigen::RowVectorXd(2 * solve.row(2) / (scale * scale)) : Eigen::RowVectorXd::Zero(n);
}

Eigen::VectorXd Denoised(const Eigen::VectorXd& signal, double noise) {
  const int n = static_cast<int>(signal.size());
  if (noise <= 0 || !signal.allFinite()) return signal;
  // Sums up to each sample, of the signal less its mean for precision.
  const double mean = signal.mean();
  Eigen::VectorXd y(n + 1), ty(n + 1), yy(n + 1);
  y[0] = ty[0] = yy[0] = 0;
  for (int i = 0; i < n; ++i) {
    const double v = signal[i] - mean;
    y[i + 1] = y[i] + v;
    ty[i + 1] = ty[i] + i * v;
    yy[i + 1] = yy[i] + v * v;
  }
  Eigen::VectorXd smooth = signal;
  for (int i = 0; i < n; ++i) {
    for (int half = 3; half <= kWidestSmoothing; half = half * 3 / 2) {
      const int a = i - half, b = i + half + 1;
      if (a < 0 || b > n) break;
      const double count = 2 * half + 1;
      const double sum = y[b] - y[a];
      const double slope_sum = ty[b] - ty[a] - i * sum;  // of (k - i) v
      const double spread = half * (half + 1.0) * count / 3;
      const double left = yy[b] - yy[a] - sum * sum / count - slope_sum * slope_sum / spread;
      // Three standard deviations of the residual of white noise; shorter windows must have passed as well.
      if (left > noise * noise * (count - 2) * (1 + 3 * std::sqrt(2 / (count - 2)))) break;
      smooth[i] = mean + sum / count;
    }
  }
  return smooth;
}

}  // namespace tendril::gap
