// Folds, weights and scores.
#include "score.h"

#include <algorithm>
#include <cmath>
#include <map>

namespace tendril::gap {
namespace {

constexpr double kLasting_s = 0.1;  // a residual that is large for half of this is not a transient

}  // namespace

const Eigen::VectorXd& Pick(const Residuals& part, const Residuals& rest, int run, int channel) {
  return part[run].empty() || part[run][channel].size() == 0 ? rest[run][channel] : part[run][channel];
}

Residuals Completed(const Residuals& part, const Residuals& rest) {
  Residuals all = rest;
  for (std::size_t i = 0; i < all.size(); ++i) {
    for (std::size_t c = 0; c < all[i].size(); ++c) {
      all[i][c] = Pick(part, rest, static_cast<int>(i), static_cast<int>(c));
    }
  }
  return all;
}

Folds MakeFolds(const std::vector<PreparedRun>& runs) {
  Folds folds;
  std::map<std::string, int> families;
  for (const auto& run : runs) families.emplace(run.family, static_cast<int>(families.size()));
  folds.of_run.resize(runs.size());
  if (families.size() >= 3) {
    folds.count = static_cast<int>(families.size());
    folds.by = "kinds of motion";
    folds.names.resize(families.size());
    for (const auto& [name, k] : families) folds.names[k] = name;
    for (std::size_t i = 0; i < runs.size(); ++i) folds.of_run[i] = families[runs[i].family];
  } else if (runs.size() >= 3) {
    // A repetition stays in the fold of its original.
    std::map<std::string, int> originals;
    for (std::size_t i = 0; i < runs.size(); ++i) {
      const std::string& key = runs[i].repeat_of.empty() ? runs[i].name : runs[i].repeat_of;
      const auto [entry, added] = originals.emplace(key, static_cast<int>(originals.size()));
      if (added) folds.names.push_back(key);
      folds.of_run[i] = entry->second;
    }
    folds.count = static_cast<int>(originals.size());
    folds.by = "runs";
  }
  if (folds.count < 2) {
    folds.by_time = true;
    folds.by = "quarters of the runs";
    folds.count = 4;
    folds.names = {"first quarter", "second quarter", "third quarter", "last quarter"};
  }
  return folds;
}

Weights::Weights(const Evaluator& evaluator, const Eigen::VectorXd& leftover) {
  const auto& channels = evaluator.channels();
  weight_ = evaluator.Variance();
  for (std::size_t i = 0; i < weight_.size(); ++i) {
    for (std::size_t c = 0; c < channels.size(); ++c) {
      const double m = evaluator.Correlated(static_cast<int>(i), static_cast<int>(c));
      const double systematic = m * (channels[c].delta * channels[c].delta + leftover[c] * leftover[c]);
      const double white = evaluator.WhiteVariance(static_cast<int>(i), static_cast<int>(c));
      const double distrust = channels[c].distrust * channels[c].distrust;
      const double misjudged = static_cast<double>(weight_[i][c].size()) * distrust;
      // Resolution errors stay correlated as long; errors of the change are correlated throughout.
      for (auto& w : weight_[i][c])
        w = 1 / (white + m * std::max(0.0, w - white - distrust) + systematic + misjudged);
    }
  }
}

Weights::Products::Products(const std::vector<const Residuals*>& columns, const Weights& weights,
                            const Folds& folds)
    : columns_(columns) {
  const int n = static_cast<int>(columns.size());
  const int runs = static_cast<int>(weights.weight_.size()),
            channels = static_cast<int>(weights.weight_[0].size());
  sums_.assign(folds.count, std::vector<Eigen::MatrixXd>(channels, Eigen::MatrixXd::Zero(n, n)));
  for (int i = 0; i < runs; ++i) {
    for (int c = 0; c < channels; ++c) {
      const auto& w = weights(i, c);
      ForEachStretch(folds, i, static_cast<int>(w.size()), [&](int fold, int from, int count) {
        Eigen::MatrixXd rooted = Eigen::MatrixXd::Zero(count, n);
        const Eigen::VectorXd root = w.segment(from, count).cwiseSqrt();
        for (int a = 0; a < n; ++a) {
          const auto& run = (*columns[a])[i];
          if (!run.empty() && run[c].size() > 0)
            rooted.col(a) = root.cwiseProduct(run[c].segment(from, count));
        }
        sums_[fold][c].selfadjointView<Eigen::Lower>().rankUpdate(rooted.transpose());
      });
    }
  }
  for (auto& fold : sums_) {
    for (Eigen::MatrixXd& sum : fold) sum = Eigen::MatrixXd(sum.selfadjointView<Eigen::Lower>());
  }
}

int Weights::Products::IndexOf(const Residuals* column) const {
  const auto found = std::find(columns_.begin(), columns_.end(), column);
  return found == columns_.end() ? -1 : static_cast<int>(found - columns_.begin());
}

void Weights::Multiply(const std::vector<const Residuals*>& columns, const Folds& folds) {
  products_ = columns.empty() ? nullptr : std::make_shared<const Products>(columns, *this, folds);
}

Weights Weights::Without(const Folds& folds, int fold) const {
  Weights others = *this;
  others.products_ = nullptr;
  for (std::size_t i = 0; i < weight_.size(); ++i) {
    for (auto& weights : others.weight_[i]) {
      const int windows = static_cast<int>(weights.size());
      for (int w = 0; w < windows; ++w) {
        if (folds.Of(static_cast<int>(i), w, windows) == fold) weights[w] = 0;
      }
    }
  }
  return others;
}

double LogScore(const Weights& weights, const Residuals& part, const Residuals& rest) {
  double sum = 0;
  for (int i = 0; i < static_cast<int>(rest.size()); ++i) {
    for (int c = 0; c < static_cast<int>(rest[i].size()); ++c) {
      const auto& r = Pick(part, rest, i, c);
      sum += (weights(i, c).array() * r.array().square()).sum();
    }
  }
  return -0.5 * sum;
}

Eigen::VectorXd CalmSquares(const Eigen::VectorXd& residual, const Eigen::VectorXd& variance,
                            const Eigen::VectorXd& expected, double window_s) {
  constexpr double kSigmas = 6;
  const int windows = static_cast<int>(residual.size());
  Eigen::VectorXd squares = residual.cwiseAbs2();
  std::vector<double> known;
  for (int w = 0; w < windows; ++w) {
    if (std::isfinite(variance[w])) known.push_back(squares[w]);
  }
  if (known.empty()) return squares;
  const auto high = known.begin() + static_cast<std::ptrdiff_t>(0.75 * static_cast<double>(known.size() - 1));
  std::nth_element(known.begin(), high, known.end());
  const double usual = kSigmas * kSigmas * *high;
  const int reach = std::max(2, static_cast<int>(std::lround(0.5 * kLasting_s / window_s)));
  Eigen::VectorXd calm = squares;
  std::vector<double> about;
  for (int w = 0; w < windows; ++w) {
    const double most = usual + kSigmas * kSigmas * expected[w];
    if (!(squares[w] > most) || !std::isfinite(variance[w])) continue;
    about.clear();
    for (int k = std::max(0, w - reach); k <= std::min(windows - 1, w + reach); ++k) {
      if (std::isfinite(variance[k])) about.push_back(squares[k]);
    }
    const auto middle = about.begin() + static_cast<std::ptrdiff_t>((about.size() - 1) / 2);
    std::nth_element(about.begin(), middle, about.end());
    calm[w] = std::min(squares[w], std::max(most, *middle));
  }
  return calm;
}

ChannelScore ScoreChannels(const Evaluator& evaluator, const Residuals& part, const Residuals& rest,
                           const std::vector<int>& runs) {
  const auto& channels = evaluator.channels();
  const int count = static_cast<int>(channels.size());
  ChannelScore score;
  score.square.setZero(count);
  score.noise.setZero(count);
  Eigen::VectorXd total = Eigen::VectorXd::Zero(count);
  for (const int i : runs) {
    for (int c = 0; c < count; ++c) {
      const auto& r = Pick(part, rest, i, c);
      const auto& v = evaluator.Variance()[i][c];
      const Eigen::VectorXd squares = CalmSquares(r, v, v, evaluator.window_s(i, c));
      for (int w = 0; w < r.size(); ++w) {
        if (!std::isfinite(v[w])) continue;
        const double weight = MeanWeight(v[w], channels[c]);
        score.square[c] += weight * squares[w];
        score.noise[c] += weight * v[w];
        total[c] += weight;
      }
    }
  }
  for (int c = 0; c < count; ++c) {
    if (total[c] > 0) score.square[c] /= total[c], score.noise[c] /= total[c];
  }
  return score;
}

ChannelScore ScoreChannels(const Evaluator& evaluator, const Residuals& part, const Residuals& rest) {
  std::vector<int> all(rest.size());
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = static_cast<int>(i);
  return ScoreChannels(evaluator, part, rest, all);
}

Eigen::VectorXd Leftover(const Evaluator& evaluator, const Residuals& part) {
  constexpr double kSlack = 1.2;  // the noise is known to within some tens of per cent
  const ChannelScore score = ScoreChannels(evaluator, part, evaluator.AtNominal());
  Eigen::VectorXd leftover(score.square.size());
  for (int c = 0; c < leftover.size(); ++c) leftover[c] = score.Excess(c, kSlack);
  return leftover;
}

}  // namespace tendril::gap
