// First choices without held-out data, without tempering, without a noise floor for model discrepancy.
#include "baselines.h"

#include <cmath>
#include <optional>

#include "score.h"

namespace tendril::gap {
namespace {

Baseline Named(const char* name, const Candidate& candidate) {
  return {name, std::string(candidate.effect->name), candidate.where};
}

/// Sum of squares over the noise, with every window counted as independent, and the number of windows.
struct Misfit {
  double chi_square = 0, windows = 0;
};
Misfit MisfitOf(const Evaluator& evaluator, const Residuals& part) {
  Misfit misfit;
  const Residuals& rest = evaluator.AtNominal();
  for (int i = 0; i < static_cast<int>(rest.size()); ++i) {
    for (int c = 0; c < static_cast<int>(rest[i].size()); ++c) {
      const auto& r = Pick(part, rest, i, c);
      const auto& v = evaluator.Variance()[i][c];
      for (int w = 0; w < r.size(); ++w) {
        if (!(v[w] > 0) || !std::isfinite(v[w])) continue;
        misfit.chi_square += r[w] * r[w] / v[w];
        misfit.windows += 1;
      }
    }
  }
  return misfit;
}

/// Bayesian information criterion of the refits and of the nominal robot.
std::optional<Baseline> RawBic(const Evaluator& evaluator, const SearchResult& search) {
  const Misfit nominal = MisfitOf(evaluator, evaluator.AtNominal());
  double least = nominal.chi_square;
  Baseline best{"raw_bic", "no_gap", ""};
  for (const Fit& fit : search.fits) {
    const Misfit misfit = MisfitOf(evaluator, fit.residuals);
    const double bic = misfit.chi_square + fit.model.size() * std::log(misfit.windows);
    if (bic < least) least = bic, best = Named("raw_bic", fit.model.parts[0]);
  }
  return best;
}

/// Least mean square of the channels, each over its floor.
std::optional<Baseline> LeastRmse(const Evaluator& evaluator, const SearchResult& search) {
  std::optional<Baseline> best;
  double least = 0;
  for (const Fit& fit : search.fits) {
    const ChannelScore score = ScoreChannels(evaluator, fit.residuals, evaluator.AtNominal());
    double sum = 0;
    for (int c = 0; c < score.square.size(); ++c)
      sum += score.square[c] / std::pow(evaluator.channels()[c].floor, 2);
    if (!best || sum < least) least = sum, best = Named("least_rmse", fit.model.parts[0]);
  }
  return best;
}

/// The first column to enter a regression with an L1 penalty on the window-to-window change of residuals: the
/// most similar one.
std::optional<Baseline> SparseRegression(const Evaluator& evaluator, const SearchResult& search) {
  const Residuals& nominal = evaluator.AtNominal();
  std::optional<Baseline> best;
  double most = 0;
  for (const Screened& s : search.screened) {
    for (const Column& column : s.columns) {
      double product = 0, square = 0;
      for (std::size_t i = 0; i < nominal.size(); ++i) {
        if (column[i].empty()) continue;
        for (std::size_t c = 0; c < nominal[i].size(); ++c) {
          const auto& j = column[i][c];
          const auto& r = nominal[i][c];
          const auto& v = evaluator.Variance()[i][c];
          for (int w = 1; w < j.size(); ++w) {
            const double variance = v[w] + v[w - 1];
            if (!(variance > 0) || !std::isfinite(variance)) continue;
            product += (j[w] - j[w - 1]) * (r[w] - r[w - 1]) / variance;
            square += (j[w] - j[w - 1]) * (j[w] - j[w - 1]) / variance;
          }
        }
      }
      const double alike = square > 0 ? std::abs(product) / std::sqrt(square) : 0;
      if (alike > most) most = alike, best = Named("sparse_regression", s.candidate);
    }
  }
  return best;
}

/// All numbers of the nominal file refitted together: the one that changes most.
std::optional<Baseline> RefitEverything(const SearchResult& search) {
  std::optional<Baseline> best;
  double most = 0;
  for (const auto& [candidate, moved] : search.everything_moved) {
    if (std::abs(moved) > most) most = std::abs(moved), best = Named("refit_everything", candidate);
  }
  return best;
}

}  // namespace

std::vector<Baseline> Baselines(const Evaluator& evaluator, const SearchResult& search) {
  std::vector<Baseline> all;
  for (const auto& one : {LeastRmse(evaluator, search), RawBic(evaluator, search), RefitEverything(search),
                          SparseRegression(evaluator, search)}) {
    if (one) all.push_back(*one);
  }
  return all;
}

}  // namespace tendril::gap
