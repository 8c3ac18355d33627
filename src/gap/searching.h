// The search's stages and what they share. Private to search.cpp and pairs.cpp.
#pragma once

#include <vector>

#include "probes.h"
#include "search.h"

namespace tendril::gap {

/// A value that is not quite at a bound of its parameter.
double Inside(const sim::EffectParameter& parameter, double value);

/// One of them is said to be taken for the other.
bool LookAlike(const sim::Effect& a, const sim::Effect& b);

class Searching {
 public:
  Searching(const Evaluator& evaluator, const Folds& folds, const SearchOptions& options,
            const std::vector<Probe>& probes);

  SearchResult Result();

 private:
  /// Where a stage begins and ends in the whole.
  struct Span {
    double from = 1, to = 1;
  };

  // In search.cpp.
  void Progress(double fraction) const {
    if (options_.progress) options_.progress(fraction);
  }
  void FindNuisances();
  std::vector<Screened> Screen(const Weights& weights) const;
  double BaseScore(const Weights& weights) const;
  void ScreenAll();
  void RefitBest();
  void RefitEverything();
  bool Explained(const Fit& fit) const;
  /// Sorted so. Of starts that cannot be simulated, what `unless` has of them stays.
  std::vector<Fit> Refit(const std::vector<Model>& starts, const Weights& weights, int iterations, Span span,
                         const std::vector<Fit>* unless = nullptr) const;
  /// The first `count` of `fits` refitted once more from where they are.
  std::vector<Fit> Polished(std::vector<Fit> fits, std::ptrdiff_t count, const Weights& weights,
                            Span span) const;
  /// The best are held out by refits where a straight line loses much for one of them, or `anyway`: what is
  /// compared has to be held out alike. True when it was done.
  bool HoldOutAgain(std::vector<Fit>& fits, const Weights& weights, bool anyway) const;

  // In pairs.cpp: add a second, then try others in the place of the first.
  void FindPairs();
  Residuals AtModel(const Model& model) const;  // of all channels, nuisances at nominal
  struct Promise {
    double gain = -1e300;  // held-out log score
    int candidate = 0;     // of result_.screened
    Eigen::VectorXd step;  // of its own parameters, then of the first's
  };
  std::vector<Promise> Promises(const Fit& first, const Weights& weights) const;
  std::vector<Model> Partners(const Fit& first, const Weights& weights, int count, double least,
                              const sim::Effect* like = nullptr) const;
  std::vector<Model> Together(const Weights& weights, std::size_t count) const;
  bool Tried(const Model& both) const;
  std::vector<Model> Elsewhere() const;
  std::vector<Model> Alike(const Weights& weights) const;
  void KeepDistinct();
  void AddMembers(const Weights& weights, bool held_out_again);

  const Evaluator& evaluator_;
  const Folds& folds_;
  const SearchOptions& options_;
  const Residuals& nominal_;
  const std::vector<Probe>& probes_;
  std::vector<Candidate> candidates_;  // of the probes, each once
  Eigen::VectorXd leftover_;           // per channel: what the best leaves beyond the noise
  bool singles_again_ = false;         // held out by refits
  SearchResult result_;
};

}  // namespace tendril::gap
