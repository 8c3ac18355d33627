// Normal equations by fold, solved with an active set.
#include "linear_fit.h"

#include <Eigen/Dense>
#include <algorithm>

#include "hypothesis.h"

namespace tendril::gap {
namespace {

// Share of a parameter's information that the other folds must have for the fold to be held out.
constexpr double kElsewhere = 0.02;

void Append(Eigen::VectorXd& x, double value) {
  x.conservativeResize(x.size() + 1);
  x[x.size() - 1] = value;
}

}  // namespace

Eigen::VectorXd Bounded(const Eigen::MatrixXd& H, const Eigen::VectorXd& g, const Eigen::VectorXd& lower,
                        const Eigen::VectorXd& upper) {
  const int n = static_cast<int>(g.size());
  Eigen::VectorXd x = Eigen::VectorXd::Zero(n);
  std::vector<char> fixed(n, 0);
  for (int pass = 0; pass <= n; ++pass) {
    std::vector<int> free;
    for (int k = 0; k < n; ++k) {
      if (!fixed[k]) free.push_back(k);
    }
    if (free.empty()) break;
    Eigen::MatrixXd Hf(free.size(), free.size());
    Eigen::VectorXd gf(free.size());
    for (std::size_t a = 0; a < free.size(); ++a) {
      gf[a] = g[free[a]];
      for (int k = 0; k < n; ++k) {
        if (fixed[k]) gf[a] -= H(free[a], k) * x[k];
      }
      for (std::size_t b = 0; b < free.size(); ++b) Hf(a, b) = H(free[a], free[b]);
    }
    Eigen::VectorXd xf = Hf.ldlt().solve(gf);
    if (!xf.allFinite()) xf.setZero();  // nothing depends on these
    bool all_inside = true;
    for (std::size_t a = 0; a < free.size(); ++a) {
      const int k = free[a];
      x[k] = std::clamp(xf[a], lower[k], upper[k]);
      if (x[k] != xf[a]) fixed[k] = 1, all_inside = false;
    }
    if (all_inside) break;
  }
  return x;
}

int OnlyFold(const Normal& normal, int own) {
  for (int k = 0; k < own; ++k) {
    double sum = 0;
    for (const auto& A : normal.A) sum += A(k, k);
    for (std::size_t f = 0; f < normal.A.size(); ++f) {
      if (sum > 0 && sum - normal.A[f](k, k) < kElsewhere * sum) return static_cast<int>(f);
    }
  }
  return -1;
}

Normal Accumulate(const std::vector<const Column*>& columns, const Residuals& part, const Residuals& rest,
                  const Weights& weights, const Folds& folds) {
  const int n = static_cast<int>(columns.size());
  Normal normal;
  normal.A.assign(folds.count, Eigen::MatrixXd::Zero(n, n));
  normal.b.assign(folds.count, Eigen::VectorXd::Zero(n));
  const Weights::Products* products = weights.products();
  std::vector<int> known(n, -1);
  for (int a = 0; products != nullptr && a < n; ++a) known[a] = products->IndexOf(columns[a]);
  const auto add = [&](int fold, int run, int channel, int from, int count) {
    const auto& r = Pick(part, rest, run, channel);
    const auto w = weights(run, channel).segment(from, count).array();
    const auto rs = r.segment(from, count).array();
    for (int a = 0; a < n; ++a) {
      const auto& ja = (*columns[a])[run];
      if (ja.empty() || ja[channel].size() == 0) continue;
      const Eigen::ArrayXd wj = w * ja[channel].segment(from, count).array();
      normal.b[fold][a] += (wj * rs).sum();
      for (int b = 0; b < n; ++b) {
        // Each pair once, and those that are known not at all.
        if ((known[a] >= 0 && known[b] >= 0) || (b > a && known[b] < 0) || (b < a && known[a] >= 0)) continue;
        const auto& jb = (*columns[b])[run];
        if (jb.empty() || jb[channel].size() == 0) continue;
        const double product = (wj * jb[channel].segment(from, count).array()).sum();
        normal.A[fold](a, b) += product;
        if (a != b) normal.A[fold](b, a) += product;
      }
    }
  };
  for (int i = 0; i < static_cast<int>(rest.size()); ++i) {
    for (int c = 0; c < static_cast<int>(rest[i].size()); ++c) {
      const int windows = static_cast<int>(Pick(part, rest, i, c).size());
      ForEachStretch(folds, i, windows, [&](int fold, int from, int count) { add(fold, i, c, from, count); });
    }
  }
  for (int a = 0; a < n; ++a) {
    for (int b = 0; b < n; ++b) {
      if (known[a] < 0 || known[b] < 0) continue;
      for (int f = 0; f < folds.count; ++f) {
        for (int c = 0; c < products->channels(); ++c)
          normal.A[f](a, b) += products->At(f, c, known[a], known[b]);
      }
    }
  }
  return normal;
}

void Bounds::Add(const sim::EffectParameter& parameter, double value) {
  Append(prior, kFlatPrior * ScaleOf(parameter));
  Append(center, 0);
  Append(lower, parameter.lower - value);
  Append(upper, parameter.upper - value);
}

void Bounds::AddNuisance(double deviation, double at) {
  Append(prior, deviation);
  Append(center, at);
  Append(lower, std::min(at, 0.0) - 3 * deviation);
  Append(upper, std::max(at, 0.0) + 3 * deviation);
}

Eigen::MatrixXd Bounds::Precision() const { return prior.array().square().inverse().matrix().asDiagonal(); }

double Bounds::LogPrior(const Eigen::VectorXd& change) const {
  const auto of = [&](const auto& x) { return ((x - center).array() / prior.array()).square().sum(); };
  return 0.5 * (of(Eigen::VectorXd::Zero(change.size()).eval()) - of(change));
}

LinearFit SolveLinear(const Normal& normal, const Bounds& bounds, int own) {
  const int n = normal.size();
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(n, n);
  Eigen::VectorXd b = Eigen::VectorXd::Zero(n);
  const Eigen::MatrixXd regular = bounds.Precision();
  const Eigen::VectorXd pull = regular * bounds.center;
  for (std::size_t f = 0; f < normal.A.size(); ++f) A += normal.A[f], b += normal.b[f];
  LinearFit fit;
  fit.value = Bounded(A + regular, b + pull, bounds.lower, bounds.upper);
  const double prior = bounds.LogPrior(fit.value);
  fit.score = fit.value.dot(b) - 0.5 * fit.value.dot(A * fit.value) + prior;
  fit.held_out_score = prior;
  const int only = OnlyFold(normal, own);
  for (std::size_t f = 0; f < normal.A.size(); ++f) {
    const bool predicted = static_cast<int>(f) != only;
    const Eigen::VectorXd x =
        predicted ? Bounded(A - normal.A[f] + regular, b - normal.b[f] + pull, bounds.lower, bounds.upper)
                  : fit.value;
    fit.held_out_score += x.dot(normal.b[f]) - 0.5 * x.dot(normal.A[f] * x) - (predicted ? 0 : kOnlyFoldCost);
  }
  return fit;
}

}  // namespace tendril::gap
