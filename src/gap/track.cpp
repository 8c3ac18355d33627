// One linear step to every effect alone, from the screening's columns, as numbers with deviations.
#include "tendril/gap/track.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>

#include "comparable.h"
#include "evaluator.h"
#include "linear_fit.h"
#include "measurement_check.h"
#include "probes.h"
#include "readable.h"
#include "score.h"
#include "search.h"
#include "tendril/core/parallel.h"
#include "tendril/gap/report.h"

namespace tendril::gap {
namespace {

/// The first probe of each effect at each place, where it begins at no effect and has a response there.
std::vector<const Probe*> AboutNominal(const std::vector<Probe>& probes) {
  std::vector<const Probe*> chosen;
  for (const Probe& probe : probes) {
    const bool begun = std::any_of(chosen.begin(), chosen.end(),
                                   [&](const Probe* other) { return other->candidate == probe.candidate; });
    const bool from_nothing = std::all_of(probe.primary.begin(), probe.primary.end(), [&](int k) {
      return probe.variant.values[k] == probe.candidate.parameters[static_cast<std::size_t>(k)].nominal;
    });
    if (!begun && from_nothing && probe.each < 0) chosen.push_back(&probe);
  }
  return chosen;
}

/// Mean squares of a column by channel.
Eigen::VectorXd MeanSquares(const Evaluator& evaluator, const Column& column) {
  const auto& channels = evaluator.channels();
  Eigen::VectorXd square = Eigen::VectorXd::Zero(static_cast<int>(channels.size())), total = square;
  for (std::size_t i = 0; i < column.size(); ++i) {
    for (std::size_t c = 0; c < column[i].size(); ++c) {
      const Eigen::VectorXd& variance = evaluator.Variance()[i][c];
      for (Eigen::Index w = 0; w < column[i][c].size(); ++w) {
        if (!std::isfinite(variance[w])) continue;
        const double weight = MeanWeight(variance[w], channels[c]);
        square[static_cast<int>(c)] += weight * column[i][c][w] * column[i][c][w];
        total[static_cast<int>(c)] += weight;
      }
    }
  }
  for (int c = 0; c < square.size(); ++c) {
    if (total[c] > 0) square[c] /= total[c];
  }
  return square;
}

double MaterialChange(const Evaluator& evaluator, const Column& column) {
  const Eigen::VectorXd square = MeanSquares(evaluator, column);
  double most = 0;
  for (int c = 0; c < square.size(); ++c)
    most = std::max(most, std::sqrt(square[c]) / evaluator.channels()[static_cast<std::size_t>(c)].delta);
  return 1 / most;
}

class Tracker {
 public:
  Tracker(const DataSet& given, const TrackOptions& options)
      : options_(options), threads_(options.threads > 0 ? options.threads : AllCores()) {
    DataSet set = Readable(given, found_.notes).set;
    DiagnoseOptions reading;
    reading.delta_N = options.delta_N;
    reading.delta_m = options.delta_m;
    reading.seed = options.seed;
    reading.progress = options.progress;
    evaluator_.emplace(MeasurementCheck(set, found_.notes, reading, threads_, false).PrepareComparable());
    for (const std::string& line : evaluator_->degradations()) found_.notes.push_back(line);
    folds_ = MakeFolds(evaluator_->runs());
  }

  Tracking Result() {
    const auto probes = MakeProbes(
        *evaluator_, [](const Candidate&) { return false; }, threads_,
        [this](double fraction) { Progress(fraction); });
    SearchOptions searching;
    searching.threads = threads_;
    const SearchResult screened = ScreenOnly(*evaluator_, folds_, searching, probes);
    ListChannels(screened.leftover);
    const Weights weights(*evaluator_, discrepancy_);
    const auto chosen = AboutNominal(probes);
    std::vector<std::vector<TrackedParameter>> tracked(chosen.size());
    ParallelFor(static_cast<int>(chosen.size()), threads_, [&](int p) {
      const auto at = static_cast<std::size_t>(p);
      tracked[at] = Tracked(*chosen[at], screened.nuisances, weights);
    });
    for (auto& of_one : tracked)
      found_.parameters.insert(found_.parameters.end(), of_one.begin(), of_one.end());
    return std::move(found_);
  }

 private:
  void ListChannels(const Eigen::VectorXd& leftover) {
    const ChannelScore score = ScoreChannels(*evaluator_, evaluator_->AtNominal(), evaluator_->AtNominal());
    discrepancy_ = leftover;
    for (int c = 0; c < leftover.size(); ++c) {
      const Channel& channel = evaluator_->channels()[static_cast<std::size_t>(c)];
      const auto given = options_.discrepancy.find(channel.name);
      if (given != options_.discrepancy.end()) discrepancy_[c] = given->second;
      found_.channels.push_back({channel.name, channel.unit, std::sqrt(score.square[c]), channel.floor,
                                 channel.delta, leftover[c]});
    }
  }

  /// Without parameters of which the runs say little beside the prior: these would follow the prior.
  std::vector<TrackedParameter> Tracked(const Probe& probe, const Nuisances& nuisances,
                                        const Weights& weights) const {
    std::vector<const Column*> columns;
    Bounds bounds;
    for (std::size_t k = 0; k < probe.primary.size(); ++k) {
      columns.push_back(&probe.columns[k]);
      bounds.Add(probe.variant.parameter(probe.primary[k]), probe.variant.values[probe.primary[k]]);
    }
    for (const Nuisance& nuisance : nuisances) {
      if (nuisance.effect == probe.candidate.effect) continue;
      columns.push_back(nuisance.column.get());
      bounds.AddNuisance(nuisance.prior, nuisance.center);
    }
    const Residuals& residuals = evaluator_->AtNominal();
    const Normal normal = Accumulate(columns, residuals, residuals, weights, folds_);
    Eigen::MatrixXd curvature = bounds.Precision();
    Eigen::VectorXd slope = curvature * bounds.center;
    for (std::size_t f = 0; f < normal.A.size(); ++f) curvature += normal.A[f], slope += normal.b[f];
    const Eigen::MatrixXd covariance =
        curvature.ldlt().solve(Eigen::MatrixXd::Identity(curvature.rows(), curvature.cols()));
    const Eigen::VectorXd change = covariance * slope;
    std::vector<TrackedParameter> tracked;
    for (std::size_t k = 0; k < probe.primary.size(); ++k) {
      const auto at = static_cast<Eigen::Index>(k);
      const double material = MaterialChange(*evaluator_, probe.columns[k]);
      const double deviation = std::sqrt(covariance(at, at));
      if (!std::isfinite(material) || !std::isfinite(deviation) || !(deviation < bounds.prior[at] / 2))
        continue;
      tracked.push_back({std::string(probe.candidate.effect->name), probe.candidate.where,
                         probe.variant.parameter(probe.primary[k]).name,
                         probe.variant.values[probe.primary[k]] + change[at], deviation, material});
    }
    return tracked;
  }

  void Progress(double fraction) const {
    if (options_.progress) options_.progress("following every effect", fraction);
  }

  const TrackOptions& options_;
  const int threads_;
  Tracking found_;
  std::optional<Evaluator> evaluator_;
  Folds folds_;
  Eigen::VectorXd discrepancy_;
};

}  // namespace

Tracking Track(const DataSet& set, const TrackOptions& options) {
  if (Compared(set))
    throw std::runtime_error("runs from before a change: accepted: runs of the robot as it is, without them");
  return Tracker(set, options).Result();
}

std::string TrackingJson(const Tracking& tracking) {
  using Json = nlohmann::ordered_json;
  Json json{{"parameters", Json::array()}, {"channels", Json::array()}, {"notes", tracking.notes}};
  for (const TrackedParameter& p : tracking.parameters) {
    const ParameterText text = TextOf(p.name);
    json["parameters"].push_back({{"effect", p.effect},
                                  {"where", p.where},
                                  {"name", p.name},
                                  {"unit", text.unit},
                                  {"value", p.value},
                                  {"deviation", p.deviation},
                                  {"material", p.material}});
  }
  for (const TrackedChannel& c : tracking.channels) {
    json["channels"].push_back({{"name", c.name},
                                {"unit", c.unit},
                                {"rms", c.rms},
                                {"floor", c.floor},
                                {"delta", c.delta},
                                {"discrepancy", c.discrepancy}});
  }
  return json.dump();
}

}  // namespace tendril::gap
