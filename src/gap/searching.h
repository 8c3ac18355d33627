// The stages of the search and their shared state. Private to search.cpp and pairs.cpp.
#pragma once

#include <vector>

#include "probes.h"
#include "search.h"

namespace tendril::gap {

inline constexpr int kIterations = 3;  // of a refit

/// The value, moved slightly off a bound of its parameter.
double Inside(const sim::EffectParameter& parameter, double value);

/// True where the registry lists one of them as confusable with the other.
bool LookAlike(const sim::Effect& a, const sim::Effect& b);

class Searching {
 public:
  Searching(const Evaluator& evaluator, const Folds& folds, const SearchOptions& options,
            const std::vector<Probe>& probes);

  SearchResult Result();
  SearchResult ScreenedOnly();

 private:
  /// Begin and end of a stage within the total progress.
  struct Span {
    double from = 1, to = 1;
  };

  // In search.cpp.
  void Progress(double fraction) const {
    if (options_.progress) options_.progress(fraction);
  }
  void FindNuisances();
  /// Weights with the present leftover, and the products of the nuisances.
  Weights WeightsNow() const;
  std::vector<Screened> Screen(const Weights& weights) const;
  double BaseScore(const Weights& weights) const;
  void ScreenAll();
  void RefitBest();
  void RefitEverything();
  bool Explained(const Fit& fit) const;
  /// Refits, sorted by score. For starts that cannot be simulated, those of `unless` are kept.
  std::vector<Fit> Refit(const std::vector<Model>& starts, const Weights& weights, int iterations, Span span,
                         const std::vector<Fit>* unless = nullptr) const;
  /// The first `count` of `fits` refitted again from their optimum.
  std::vector<Fit> Polished(std::vector<Fit> fits, std::ptrdiff_t count, const Weights& weights,
                            Span span) const;
  /// Scores the best on held-out folds by refits where the linear step loses much for one of them, or where
  /// `anyway`: fits are comparable only if held out by the same method. True when it was done.
  bool HoldOutAgain(std::vector<Fit>& fits, const Weights& weights, bool anyway) const;

  // In pairs.cpp: adds a second cause, then tries others in place of the first.
  void FindPairs();
  Residuals AtModel(const Model& model) const;  // of all channels, nuisances at nominal
  struct SecondCause {
    double gain = -1e300;  // held-out log score
    int candidate = 0;     // index into result_.screened
    Eigen::VectorXd step;  // step of its own parameters, then of the first cause's
  };
  std::vector<SecondCause> SecondCauses(const Fit& first, const Weights& weights) const;
  std::vector<Model> PairStarts(const Fit& first, const Weights& weights, int count, double least,
                                const sim::Effect* like = nullptr) const;
  std::vector<Model> PairsOfSingles(const Weights& weights, std::size_t count) const;
  bool Tried(const Model& both) const;
  std::vector<Model> AtOtherPlaces() const;
  std::vector<Model> LookAlikePairs(const Weights& weights) const;
  void KeepDistinct();
  void AddMembers(const Weights& weights, bool held_out_again);

  const Evaluator& evaluator_;
  const Folds& folds_;
  const SearchOptions& options_;
  const Residuals& nominal_;
  const std::vector<Probe>& probes_;
  std::vector<Candidate> candidates_;  // the candidates of the probes, without duplicates
  Eigen::VectorXd leftover_;           // per channel: residual of the best fit beyond the noise
  bool singles_again_ = false;         // single causes were held out by refits
  SearchResult result_;
};

}  // namespace tendril::gap
