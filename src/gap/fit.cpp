// Bounded refits by Ceres, folds by one Gauss-Newton step from the common optimum or by refits.
#include "fit.h"

#include <ceres/ceres.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace tendril::gap {

Column Sensitivity(const Evaluator& evaluator, const Model& model, int k, double step,
                   const Residuals& at_model, unsigned cuts, sim::Replay::Steps steps) {
  Model moved = model;
  const auto& p = model.parameter(k);
  double to = model.values[k] + step;
  if (to > p.upper || to < p.lower) to = model.values[k] - step;
  to = std::clamp(to, p.lower, p.upper);
  const double change = to - model.values[k];
  if (change == 0) return Column(at_model.size(), std::vector<Eigen::VectorXd>(evaluator.channels().size()));
  moved.values[k] = to;
  Column column = evaluator.At(moved.Robot(evaluator.nominal()), cuts, {}, steps);
  for (std::size_t i = 0; i < column.size(); ++i) {
    for (std::size_t c = 0; c < column[i].size(); ++c) {
      if (column[i][c].size() > 0) column[i][c] = (at_model[i][c] - column[i][c]) / change;
    }
  }
  return column;
}

unsigned CutsOf(const Evaluator& evaluator, const Model& model) {
  unsigned cuts = 0;
  for (const Candidate& part : model.parts) cuts |= evaluator.CutsOf(*part.effect);
  return cuts;
}

namespace {

/// Every constant that the model may adjust follows the model's own parameters by linear least squares, also
/// on the channels that these do not reach.
class Followers {
 public:
  /// `reached`: residuals of the channels that the model reaches; on the others those of the nominal robot.
  Followers(const Nuisances& nuisances, const Weights& weights, const Residuals& reached,
            const Residuals& nominal)
      : weights_(weights) {
    Bounds bounds;
    nuisances.AddTo(columns_, bounds);
    if (columns_.empty()) return;
    beside_ = bounds.Precision();
    pull_ = beside_ * bounds.center;
    Eigen::MatrixXd within = Eigen::MatrixXd::Zero(size(), size());
    for (int c = 0; c < static_cast<int>(nominal.front().size()); ++c) {
      const bool is_reached = std::any_of(reached.begin(), reached.end(),
                                          [c](const auto& run) { return !run.empty() && run[c].size() > 0; });
      AddProducts(c, nominal, is_reached ? within : beside_);
      for (int i = 0; !is_reached && i < static_cast<int>(nominal.size()); ++i)
        AddProducts(i, c, nominal[i][c], pull_);
    }
    all_.compute(beside_ + within);
    root_ = beside_.llt().matrixL();
  }

  int size() const { return static_cast<int>(columns_.size()); }

  /// Their changes for these residuals, or (`pulled` false) for a change of the residuals.
  Eigen::VectorXd Follow(const Residuals& residuals, bool pulled) const {
    Eigen::VectorXd b = pulled ? pull_ : Eigen::VectorXd::Zero(size());
    for (int i = 0; i < static_cast<int>(residuals.size()); ++i) {
      for (int c = 0; c < static_cast<int>(residuals[i].size()); ++c) AddProducts(i, c, residuals[i][c], b);
    }
    return all_.solve(b);
  }

  /// Rows whose half square is what the changes cost beside the reached channels.
  Eigen::VectorXd Rows(const Eigen::VectorXd& changes, bool pulled) const {
    Eigen::VectorXd rows = root_.transpose() * changes;
    if (pulled) rows -= root_.triangularView<Eigen::Lower>().solve(pull_);
    return rows;
  }

  /// Subtracts their response at one channel of a run.
  void Subtract(int run, int channel, const Eigen::VectorXd& changes, Eigen::VectorXd& from) const {
    for (int e = 0; e < size(); ++e) {
      if (const Eigen::VectorXd* j = Response(e, run, channel)) from -= changes[e] * *j;
    }
  }

 private:
  const Eigen::VectorXd* Response(int e, int run, int channel) const {
    const auto& of_run = (*columns_[e])[run];
    return of_run.empty() || of_run[channel].size() == 0 ? nullptr : &of_run[channel];
  }

  /// w j r of one channel.
  void AddProducts(int run, int channel, const Eigen::VectorXd& residual, Eigen::VectorXd& sum) const {
    if (residual.size() == 0) return;
    const Eigen::VectorXd weighted = weights_(run, channel).cwiseProduct(residual);
    for (int e = 0; e < size(); ++e) {
      if (const Eigen::VectorXd* j = Response(e, run, channel)) sum[e] += j->dot(weighted);
    }
  }

  /// w j j' of one channel in all runs, as computed before where the weights know it.
  void AddProducts(int channel, const Residuals& runs, Eigen::MatrixXd& sum) const {
    if (const Weights::Products* known = weights_.products()) {
      std::vector<int> at;
      for (const Column* column : columns_) at.push_back(known->IndexOf(column));
      if (std::find(at.begin(), at.end(), -1) == at.end()) {
        for (int a = 0; a < size(); ++a) {
          for (int b = 0; b < size(); ++b) sum(a, b) += known->At(channel, at[a], at[b]);
        }
        return;
      }
    }
    for (int i = 0; i < static_cast<int>(runs.size()); ++i) {
      for (int a = 0; a < size(); ++a) {
        const Eigen::VectorXd* ja = Response(a, i, channel);
        if (ja == nullptr) continue;
        const Eigen::VectorXd weighted = weights_(i, channel).cwiseProduct(*ja);
        for (int b = 0; b <= a; ++b) {
          const Eigen::VectorXd* jb = Response(b, i, channel);
          if (jb == nullptr) continue;
          const double product = jb->dot(weighted);
          sum(a, b) += product;
          if (a != b) sum(b, a) += product;
        }
      }
    }
  }

  const Weights& weights_;
  std::vector<const Column*> columns_;
  Eigen::VectorXd pull_;                // of priors and channels beside
  Eigen::MatrixXd beside_, root_;       // their curvature, and its lower factor
  Eigen::LDLT<Eigen::MatrixXd> all_{};  // with that of the reached channels
};

/// Weighted residuals of the channels that the model reaches, nuisances following; then what these cost.
class Cost final : public ceres::CostFunction {
 public:
  Cost(const Evaluator& evaluator, const Weights& weights, const Nuisances& nuisances, const Model& model,
       unsigned cuts)
      : evaluator_(evaluator),
        weights_(weights),
        model_(model),
        cuts_(cuts),
        followers_(nuisances, weights, ResidualsOf(model_), evaluator.AtNominal()) {
    for (const auto& run : ResidualsOf(model_)) {
      for (const auto& channel : run) data_rows_ += static_cast<int>(channel.size());
    }
    set_num_residuals(data_rows_ + followers_.size() + model_.size());
    mutable_parameter_block_sizes()->push_back(model_.size());
  }

  /// Simulates each point once: the solver asks for residuals first and for derivatives there later.
  const Residuals& ResidualsOf(const Model& model) const {
    if (linear_.IsOf(model)) return linear_.residuals;
    if (!tried_.IsOf(model)) {
      tried_.residuals = evaluator_.At(model.Robot(evaluator_.nominal()), cuts_);
      tried_.values = model.values;
    }
    return tried_.residuals;
  }

  const std::vector<Column>& SensitivitiesOf(const Model& model) const {
    if (linear_.IsOf(model)) return linear_.columns;
    Point point{model.values, ResidualsOf(model), {}};
    for (int k = 0; k < model.size(); ++k) {
      point.columns.push_back(
          Sensitivity(evaluator_, model, k, model.derivative_step * Scale(k), point.residuals, cuts_));
    }
    linear_ = std::move(point);
    return linear_.columns;
  }

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    try {
      const int n = model_.size();
      Model model = model_;
      for (int k = 0; k < n; ++k) model.values[k] = parameters[0][k] * Scale(k);
      Eigen::Map<Eigen::VectorXd> out(residuals, num_residuals());
      Fill(ResidualsOf(model), ResidualsOf(model), true, 1, out);
      for (int k = 0; k < n; ++k)
        out[num_residuals() - n + k] = 1e-3 * (parameters[0][k] - model_.parameter(k).nominal / Scale(k));
      if (jacobians == nullptr || jacobians[0] == nullptr) return true;
      Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> J(
          jacobians[0], num_residuals(), n);
      Eigen::VectorXd column(num_residuals());
      const std::vector<Column>& sensitivities = SensitivitiesOf(model);
      for (int k = 0; k < n; ++k) {
        Fill(sensitivities[k], linear_.residuals, false, -Scale(k), column);
        column.tail(n).setZero();
        column[num_residuals() - n + k] = 1e-3;
        J.col(k) = column;
      }
      return true;
    } catch (const std::exception&) {
      return false;  // cannot be simulated: the solver shortens the step
    }
  }

  double Scale(int k) const { return ScaleOf(model_.parameter(k)); }

 private:
  /// factor times the rows of `values` in the channels of `like`, nuisances following them (`pulled`: or
  /// their change).
  template <class Out>
  void Fill(const Residuals& values, const Residuals& like, bool pulled, double factor, Out& out) const {
    const Eigen::VectorXd following =
        followers_.size() > 0 ? followers_.Follow(values, pulled) : Eigen::VectorXd();
    int row = 0;
    for (int i = 0; i < static_cast<int>(like.size()); ++i) {
      for (int c = 0; c < static_cast<int>(like[i].size()); ++c) {
        const auto size = like[i][c].size();
        if (size == 0) continue;
        const bool has = !values[i].empty() && values[i][c].size() > 0;
        Eigen::VectorXd r = has ? values[i][c] : Eigen::VectorXd::Zero(size);
        followers_.Subtract(i, c, following, r);
        out.segment(row, size) = factor * weights_(i, c).array().sqrt() * r.array();
        row += static_cast<int>(size);
      }
    }
    if (followers_.size() > 0)
      out.segment(row, followers_.size()) = factor * followers_.Rows(following, pulled);
  }

  const Evaluator& evaluator_;
  const Weights& weights_;
  Model model_;
  unsigned cuts_;
  int data_rows_ = 0;

  struct Point {
    Eigen::VectorXd values;
    Residuals residuals;
    std::vector<Column> columns;

    bool IsOf(const Model& model) const {
      return values.size() == model.values.size() && !residuals.empty() && values == model.values;
    }
  };
  mutable Point tried_, linear_;  // last points of a residual and of a derivative evaluation
  Followers followers_;
};

/// Jackknife covariance of the estimates without each fold. It includes model discrepancy, by which folds
/// differ, in addition to noise.
Eigen::MatrixXd CovarianceOf(const std::vector<Eigen::VectorXd>& estimates) {
  const auto n = estimates.front().size(), folds = static_cast<Eigen::Index>(estimates.size());
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(n);
  for (const auto& x : estimates) mean += x / static_cast<double>(folds);
  Eigen::MatrixXd scatter = Eigen::MatrixXd::Zero(n, n);
  for (const auto& x : estimates) scatter += (x - mean) * (x - mean).transpose();
  return scatter * (static_cast<double>(folds) - 1) / static_cast<double>(folds);
}

/// Moves the solver's variables to the optimum within their bounds: the parameters of `start` in units of
/// their scales.
void Minimise(Cost& cost, const Model& start, int iterations, std::vector<double>& x) {
  ceres::Problem::Options owner;
  owner.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(owner);
  problem.AddResidualBlock(&cost, nullptr, x.data());
  for (int k = 0; k < start.size(); ++k) {
    problem.SetParameterLowerBound(x.data(), k, start.parameter(k).lower / cost.Scale(k));
    problem.SetParameterUpperBound(x.data(), k, start.parameter(k).upper / cost.Scale(k));
  }
  ceres::Solver::Options options;
  options.max_num_iterations = iterations;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  options.function_tolerance = 1e-4;
  options.parameter_tolerance = 1e-5;
  options.logging_type = ceres::SILENT;
  options.num_threads = 1;
  options.max_num_consecutive_invalid_steps = 3;
  // Bounds would add a projected line search to each step, at two or more simulations per trial, although the
  // trust region already handles them.
  options.max_num_line_search_step_size_iterations = 0;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
}

/// The model at the solver's variables, and which of its parameters are at a bound.
Fit AtSolution(const Cost& cost, const Model& start, const std::vector<double>& x) {
  Fit fit;
  fit.model = start;
  for (int k = 0; k < start.size(); ++k) {
    const auto& p = start.parameter(k);
    if (!std::isfinite(x[k])) throw std::runtime_error("no estimate of " + start.parts.front().Name());
    fit.model.values[k] = x[k] * cost.Scale(k);
    const double width = p.upper - p.lower;
    const bool at_bound =
        fit.model.values[k] < p.lower + 1e-3 * width || fit.model.values[k] > p.upper - 1e-3 * width;
    // A law of the robot file that is removed is not at a bound.
    const bool gone = !p.shape && std::abs(fit.model.values[k] - start.nothing(k)) <= 1e-3 * width;
    if (at_bound && !gone && std::abs(fit.model.values[k] - p.nominal) > 1e-3 * width) {
      fit.bound_hit = true;
      // A factor of zero removes the number: there is no smaller value.
      const bool nothing_left = p.nominal == 1 && p.lower == 0 && fit.model.values[k] < 1e-3 * width;
      if (!p.shape && !nothing_left) fit.bound = k;
    }
  }
  return fit;
}

/// A delay and a lag of the current loop both make the torque late by their parameter `s`, a lag to first
/// order. It is known only as far as the logs show when targets were sent.
void AddUnknownDelay(double unknown_s, Fit& fit) {
  for (int part = 0; part < static_cast<int>(fit.model.parts.size()); ++part) {
    const Candidate& candidate = fit.model.parts[static_cast<std::size_t>(part)];
    if (candidate.effect->cut != sim::Cut::kCurrentLoop) continue;
    for (int k = 0; k < candidate.size(); ++k) {
      if (candidate.parameters[static_cast<std::size_t>(k)].name != "s") continue;
      const int at = fit.model.offset(part) + k;
      fit.covariance(at, at) += std::pow(unknown_s / 1.96, 2);
    }
  }
}

}  // namespace

Nuisances Nuisances::Beside(const Model& model) const {
  Nuisances beside;
  for (const Nuisance& nuisance : *this) {
    const bool own = std::any_of(model.parts.begin(), model.parts.end(),
                                 [&](const Candidate& c) { return c.effect == nuisance.effect; });
    if (!own) beside.push_back(nuisance);
  }
  return beside;
}

void Nuisances::AddTo(std::vector<const Column*>& columns, Bounds& bounds) const {
  for (const Nuisance& nuisance : *this) {
    columns.push_back(nuisance.column.get());
    bounds.AddNuisance(nuisance.prior, nuisance.center);
  }
}

double Fitter::Lost(const Fit& fit, int k, double value) const {
  Model held = fit.model;
  held.values[k] = value;
  const Residuals at = evaluator_.At(held.Robot(evaluator_.nominal()), CutsOf(evaluator_, held));
  std::vector<const Column*> columns;
  Bounds bounds;
  nuisances_.AddTo(columns, bounds);
  for (int o = 0; o < held.size(); ++o) {
    if (o == k) continue;
    columns.push_back(&fit.columns[o]);
    bounds.Add(held.parameter(o), held.values[o]);
  }
  const Residuals& rest = evaluator_.AtNominal();
  double score = LogScore(weights_, at, rest);
  if (!columns.empty()) score += SolveLinear(Accumulate(columns, at, rest, weights_, folds_), bounds).score;
  return fit.score - score;
}

void Fit::Rescore(const Weights& weights, const Residuals& rest) {
  score = LogScore(weights, residuals, rest) + log_prior;
  held_out_score = LogScore(weights, held_out, rest) + log_prior - (only_fold >= 0 ? kOnlyFoldCost : 0);
}

Fit Fitter::Refit(const Model& start, int iterations) const {
  const unsigned cuts = CutsOf(evaluator_, start);
  const int n = start.size();
  std::vector<double> x(n, 0.0);
  Model first = start;  // exactly as the solver's variables return it, so that this point is cached
  for (int k = 0; k < n; ++k) {
    const auto& p = start.parameter(k);
    x[k] = std::clamp(start.values[k], p.lower, p.upper) / ScaleOf(p);
    first.values[k] = x[k] * ScaleOf(p);
  }
  Cost cost(evaluator_, weights_, nuisances_, first, cuts);
  Minimise(cost, start, iterations, x);
  Fit fit = AtSolution(cost, start, x);
  fit.columns = cost.SensitivitiesOf(fit.model);
  HoldOutByStep(start, cost.ResidualsOf(fit.model), fit);
  return fit;
}

void Fitter::HoldOutByStep(const Model& start, const Residuals& at, Fit& fit) const {
  const int n = start.size(), extra = static_cast<int>(nuisances_.size());
  // Folds: one Gauss-Newton step from the common optimum, on each fold's complement.
  std::vector<const Column*> columns;
  Bounds bounds;
  for (const auto& column : fit.columns) columns.push_back(&column);
  for (int k = 0; k < n; ++k) bounds.Add(start.parameter(k), fit.model.values[k]);
  nuisances_.AddTo(columns, bounds);
  // Nuisances also act on channels outside these cuts; nominal residuals are used there.
  const Residuals& rest = evaluator_.AtNominal();
  const Normal normal = Accumulate(columns, at, rest, weights_, folds_);
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(n + extra, n + extra);
  Eigen::VectorXd b = Eigen::VectorXd::Zero(n + extra);
  for (std::size_t f = 0; f < normal.A.size(); ++f) A += normal.A[f], b += normal.b[f];
  const Eigen::MatrixXd regular = bounds.Precision();
  const Eigen::VectorXd pull = regular * bounds.center;
  // The model's own parameters are at their optimum; only the nuisances are refitted to all data.
  const auto leave_out = [&](int fold) {
    const Eigen::MatrixXd Af = fold < 0 ? A : Eigen::MatrixXd(A - normal.A[fold]);
    const Eigen::VectorXd bf = fold < 0 ? b : Eigen::VectorXd(b - normal.b[fold]);
    return Bounded(Af + regular, bf + pull, bounds.lower, bounds.upper);
  };
  const Eigen::VectorXd all = leave_out(-1);
  fit.nuisances = all.tail(extra);
  fit.log_prior = bounds.LogPrior(all);
  fit.only_fold = OnlyFold(normal, n);
  std::vector<Eigen::VectorXd> without;
  for (int f = 0; f < folds_.count; ++f) without.push_back(f == fit.only_fold ? all : leave_out(f));
  fit.residuals = at;
  fit.held_out = at;
  for (int i = 0; i < static_cast<int>(rest.size()); ++i) {
    for (int c = 0; c < static_cast<int>(rest[i].size()); ++c) {
      const int windows = static_cast<int>(rest[i][c].size());
      bool touched = false;
      for (const auto* column : columns) touched |= !(*column)[i].empty() && (*column)[i][c].size() > 0;
      if (!touched) continue;
      if (fit.residuals[i][c].size() == 0) fit.residuals[i][c] = fit.held_out[i][c] = rest[i][c];
      for (int k = 0; k < n + extra; ++k) {
        if ((*columns[k])[i].empty()) continue;
        const auto& j = (*columns[k])[i][c];
        if (j.size() == 0) continue;
        fit.residuals[i][c] -= all[k] * j;
        for (int w = 0; w < windows; ++w)
          fit.held_out[i][c][w] -= without[folds_.Of(i, w, windows)][k] * j[w];
      }
    }
  }
  for (int k = 0; k < n; ++k) {
    const auto& p = start.parameter(k);
    fit.model.values[k] = std::clamp(fit.model.values[k] + all[k], p.lower, p.upper);
  }
  fit.Rescore(weights_, rest);
  std::vector<Eigen::VectorXd> estimates;
  for (const auto& x_f : without) estimates.push_back(x_f.head(n));
  fit.scatter = CovarianceOf(estimates);
  const Eigen::MatrixXd inverse = (A + regular).ldlt().solve(Eigen::MatrixXd::Identity(n + extra, n + extra));
  fit.covariance = inverse.topLeftCorner(n, n) + fit.scatter;
  // A model with an error in the motion before the change is assumed to have the same relative error in the
  // change, fully correlated over all runs.
  for (int k = 0; k < n; ++k) {
    const double change = fit.model.values[k] - start.parameter(k).nominal;
    fit.covariance(k, k) += std::pow(evaluator_.wrong_before() * change, 2);
  }
  AddUnknownDelay(evaluator_.delay_unknown_s(), fit);
}

void Fitter::HoldOutByRefits(Fit& fit, int iterations) const {
  const Residuals& rest = evaluator_.AtNominal();
  std::vector<Eigen::VectorXd> estimates;
  Residuals held_out = fit.held_out;
  for (int f = 0; f < folds_.count; ++f) {
    if (f == fit.only_fold) {
      estimates.push_back(fit.model.values);
      continue;
    }
    const Weights others = weights_.Without(folds_, f);
    const Fit without = Fitter(evaluator_, folds_, others, nuisances_).Refit(fit.model, iterations);
    estimates.push_back(without.model.values);
    for (int i = 0; i < static_cast<int>(held_out.size()); ++i) {
      for (int c = 0; c < static_cast<int>(held_out[i].size()); ++c) {
        auto& r = held_out[i][c];
        const Eigen::VectorXd& predicted = Pick(without.residuals, rest, i, c);
        const int windows = static_cast<int>(r.size());
        for (int w = 0; w < windows; ++w) {
          if (folds_.Of(i, w, windows) == f) r[w] = predicted[w];
        }
      }
    }
  }
  fit.held_out = std::move(held_out);
  fit.Rescore(weights_, rest);
  fit.covariance -= fit.scatter;
  fit.scatter = CovarianceOf(estimates);
  fit.covariance += fit.scatter;
}

}  // namespace tendril::gap
