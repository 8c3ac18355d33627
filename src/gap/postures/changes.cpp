// Screened by one Gauss-Newton step with the numbers free within their posterior, the best refitted.
#include "changes.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <stdexcept>

#include "../judge.h"
#include "../rotation.h"
#include "tendril/model/body.h"
#include "tendril/sim/effects.h"

namespace tendril::gap {
namespace {

constexpr double kPlausibleFactor = 0.5;  // prior of a changed number, in its exponent
constexpr double kOfBound = 0.5;          // of an effect: two deviations are the bounds of the registry
// Weight of the discrepancy found before the change against what the states after it say of its size: it may
// be somewhat larger where the robot is bent otherwise.
constexpr double kSureStates = 20;
constexpr double kNoEvidence = -1e300;

/// An effect that is the same as another frame of the tracker.
void MoveTracker(const Candidate& c, const std::vector<double>& values, PostureRobot& robot) {
  EffectSetting setting{std::string(c.effect->name), c.where, {}};
  for (std::size_t k = 0; k < values.size(); ++k)
    setting.values.emplace_back(c.parameters[k].name, values[k]);
  RobotParameters with = robot.robot;
  with.effects = {setting};
  const sim::TrackerPlacement moved = sim::PlacementOfTracker(with);
  robot.turn_rad = RotationVector(moved.R * Rotation(robot.turn_rad));
  robot.shift_m = moved.R * robot.shift_m + moved.offset_m;
}

/// An effect's parameters at `values`, on a robot whose numbers it changes.
void Apply(const Candidate& c, const Eigen::VectorXd& values, PostureRobot& robot) {
  const std::vector<double> given(values.data(), values.data() + values.size());
  if (c.effect->edit != nullptr) {
    c.effect->edit(robot.robot, c.target, given);
  } else if (c.effect->zero) {
    MoveZero(robot, *c.effect, c.target, given[0]);
  } else {
    MoveTracker(c, given, robot);
  }
}

bool IsOfMotor(const sim::Effect& effect) {
  return effect.stage == sim::Stage::kDrive || (effect.zero && effect.parameters.front().name == "rad");
}

bool IsFactor(const sim::EffectParameter& p) { return p.nominal == 1 && p.lower > 0; }

/// Of a parameter, in prior deviations from no change: masses and lengths of slack are not negative.
double LeastOf(const sim::EffectParameter& p) {
  return p.nominal == 0 && p.lower == 0 ? 0 : -std::numeric_limits<double>::infinity();
}

/// Prior deviation of a parameter, of a factor's exponent. Bounds follow from the robot file, so that a load
/// is measured by the robot's weight and stiffness.
double PriorDeviationOf(const sim::EffectParameter& p) {
  if (IsFactor(p)) return kOfBound * 0.5 * std::log(p.upper / p.lower);
  return kOfBound * std::max(p.upper - p.nominal, p.nominal - p.lower);
}

std::optional<PostureChange> ChangeOf(const Candidate& candidate) {
  const sim::Effect& effect = *candidate.effect;
  const bool shown = effect.edit != nullptr || effect.zero || effect.frame;
  if (!shown) return std::nullopt;
  PostureChange change;
  change.effect = candidate;
  change.deviation.resize(candidate.size());
  for (int k = 0; k < candidate.size(); ++k)
    change.deviation[k] = PriorDeviationOf(candidate.parameters[static_cast<std::size_t>(k)]);
  change.apply = [change](PostureRobot& robot, const Eigen::VectorXd& z) {
    Eigen::VectorXd values(z.size());
    const Eigen::VectorXd possible = change.Possible(z);
    for (int k = 0; k < change.size(); ++k) values[k] = change.ValueAt(k, possible[k]);
    Apply(*change.effect, values, robot);
  };
  return change;
}

PostureChange ChangeOf(const FileNumber& number) {
  PostureChange change;
  change.number = number;
  change.deviation = Eigen::VectorXd::Constant(1, kPlausibleFactor);
  change.apply = [number](PostureRobot& robot, const Eigen::VectorXd& z) {
    number.apply(robot.robot, kPlausibleFactor * z[0]);
  };
  return change;
}

}  // namespace

double PostureChange::LogOneSided() const {
  double log = 0;
  for (int k = 0; effect && k < size(); ++k) {
    if (LeastOf(effect->parameters[static_cast<std::size_t>(k)]) == 0) log += std::numbers::ln2;
  }
  return log;
}

double PostureChange::ValueAt(int parameter, double z) const {
  if (number) return number->ValueAt(deviation[parameter] * z);
  const sim::EffectParameter& p = effect->parameters[static_cast<std::size_t>(parameter)];
  return IsFactor(p) ? std::exp(deviation[parameter] * z) : p.nominal + deviation[parameter] * z;
}

std::string PostureChange::OutOfRange(const Eigen::VectorXd& z) const {
  for (int k = 0; effect && k < size(); ++k) {
    const sim::EffectParameter& p = effect->parameters[static_cast<std::size_t>(k)];
    const double value = ValueAt(k, z[k]);
    if (value < p.lower || value > p.upper)
      return fmt::format("its {} of {:.3g} lies outside {:.3g} to {:.3g}", p.name, value, p.lower, p.upper);
  }
  return "";
}

Eigen::VectorXd PostureChange::Possible(Eigen::VectorXd z) const {
  for (int k = 0; effect && k < size(); ++k)
    z[k] = std::max(z[k], LeastOf(effect->parameters[static_cast<std::size_t>(k)]));
  return z;
}

namespace {

class Searching {
 public:
  Searching(const LearnedPostures& learned, const RobotParameters& file, const Postures& before,
            const Postures& after, const ChangeOptions& options)
      : learned_(learned),
        every_(std::max(1, static_cast<int>(learned.discrepancy.states_per_independent))),
        before_(before.Thinned(every_)),
        after_(after),
        options_(options),
        noise_before_{learned.discrepancy.covariance, learned.discrepancy.states_per_independent / every_},
        learned_before_m_(PredictBefore(learned.x, 0).channels_m),
        measured_(after.Stacked(&States::seen_m)) {
    out_.changes = PostureChanges(file, options.without);
    states_ = static_cast<double>(measured_.rows()) / learned.discrepancy.states_per_independent;
  }

  ChangeSearch Result() {
    const Eigen::VectorXd nothing;
    const Eigen::VectorXd& x = learned_.x;
    begin_ = PointAt(nullptr, x, nothing);
    const Point& at = begin_;
    out_.before_m = measured_ - at.predicted.channels_m;
    out_.as_filed_m = measured_ - At(nullptr, Eigen::VectorXd::Zero(x.size()), nothing, 0).channels_m;
    const Normal numbers = NormalAt(at, x, nothing);
    Screen(at, numbers);
    none_ = Refined(nullptr, x, nothing);
    out_.none_log_evidence = none_.log_evidence;
    out_.unlisted_log_evidence = Unlisted(at, numbers);
    RefineLikeliest();
    return std::move(out_);
  }

 private:
  struct Point {
    Predicted predicted;
    Eigen::MatrixXd J;         // whitened, of numbers and parameters
    Eigen::VectorXd residual;  // whitened
    // Of the states before the change and the priors, see AddBefore; empty: the quadratic holds.
    Eigen::MatrixXd J_before;
    Eigen::VectorXd residual_before;
  };
  struct Normal {
    Eigen::MatrixXd A;
    Eigen::VectorXd b;
  };

  void RefineLikeliest() {
    std::vector<ChangeFit>& fits = out_.fits;
    SharePrior();
    std::sort(fits.begin(), fits.end(), Likelier);
    const int refits = std::min(options_.refits, static_cast<int>(fits.size()));
    for (int k = 0; k < refits; ++k) {
      if (options_.progress) options_.progress(0.3 + 0.7 * k / refits);
      Refine(fits[static_cast<std::size_t>(k)]);
    }
    std::sort(fits.begin(), fits.end(), Likelier);
    // The evidence after one step can be too high, and only what is compared at its maximum is named.
    const auto may_be_named = [&](const ChangeFit& fit) {
      return !fit.refined && fits.front().log_evidence - fit.log_evidence < kSame &&
             fit.log_evidence > none_.log_evidence;
    };
    for (auto fit = std::find_if(fits.begin(), fits.end(), may_be_named); fit != fits.end();
         fit = std::find_if(fits.begin(), fits.end(), may_be_named)) {
      Refine(*fit);
      std::sort(fits.begin(), fits.end(), Likelier);
    }
    if (!fits.empty() && !fits.front().refined) Refine(fits.front());
    std::sort(fits.begin(), fits.end(), Likelier);
  }

  void SharePrior() {
    const auto name = [&](const ChangeFit& fit) {
      const PostureChange& change = out_.changes[static_cast<std::size_t>(fit.change)];
      return change.effect ? std::string(change.effect->effect->name) : change.number->key;
    };
    std::map<std::string, int> places;
    for (const ChangeFit& fit : out_.fits) ++places[name(fit)];
    for (ChangeFit& fit : out_.fits)
      fit.log_prior = -std::log(static_cast<double>(places.size()) * places[name(fit)]);
  }

  void Refine(ChangeFit& fit) {
    const int index = fit.change;
    try {
      const double log_prior = fit.log_prior;
      fit = Refined(&out_.changes[static_cast<std::size_t>(index)], learned_.x, fit.z);
      fit.log_prior = log_prior;
    } catch (const std::exception&) {
      fit.log_evidence = kNoEvidence;  // there is no such robot
    }
    if (!std::isfinite(fit.log_evidence)) fit.log_evidence = kNoEvidence;
    fit.change = index;
    fit.refined = true;
    if (fit.log_evidence > best_log_evidence_) {
      best_log_evidence_ = fit.log_evidence;
      best_explains_ = Explains(fit);
    }
  }

  static bool Likelier(const ChangeFit& a, const ChangeFit& b) { return a.LogJoint() > b.LogJoint(); }

  Predicted At(const PostureChange* change, const Eigen::VectorXd& x, const Eigen::VectorXd& z,
               Eigen::Index slopes) const {
    const Eigen::Index n = x.size();
    Eigen::VectorXd both(n + z.size());
    both << x, z;
    const auto robot = [&](const Eigen::VectorXd& at) {
      PostureRobot its = learned_.RobotAt(at.head(n));
      if (change != nullptr) change->apply(its, at.tail(at.size() - n));
      return its;
    };
    return Predict(robot, both, static_cast<int>(slopes), after_, options_.threads);
  }

  Point PointAt(const PostureChange* change, const Eigen::VectorXd& x, const Eigen::VectorXd& z) const {
    Point point{At(change, x, z, x.size() + z.size()), {}, {}, {}, {}};
    point.residual = learned_.discrepancy.Whitened(measured_ - point.predicted.channels_m);
    point.J = learned_.discrepancy.Whitened(point.predicted.slopes);
    return point;
  }

  /// What the numbers' posterior is far from its maximum, instead of the quadratic there: how far the states
  /// before are predicted from where learned_.x predicts them, and the prior.
  void AddBefore(const Eigen::VectorXd& x, Point& at, bool slopes) const {
    const Eigen::Index n = x.size();
    const Predicted there = PredictBefore(x, slopes ? n : 0);
    at.residual_before = ResidualBefore(there, x);
    if (!slopes) return;
    at.J_before.resize(at.residual_before.size(), n);
    at.J_before << noise_before_.Whitened(there.slopes),
        Eigen::MatrixXd(learned_.prior.cwiseSqrt().asDiagonal());
  }

  Predicted PredictBefore(const Eigen::VectorXd& x, Eigen::Index slopes) const {
    return Predict([&](const Eigen::VectorXd& at) { return learned_.RobotAt(at); }, x,
                   static_cast<int>(slopes), before_, options_.threads);
  }

  Eigen::VectorXd ResidualBefore(const Predicted& there, const Eigen::VectorXd& x) const {
    Eigen::VectorXd residual(learned_before_m_.size() + x.size());
    residual << noise_before_.Whitened(learned_before_m_ - there.channels_m),
        learned_.prior.cwiseSqrt().cwiseProduct(learned_.x - x);
    return residual;
  }

  /// Twice the log of the numbers' posterior at its maximum over that here.
  double SquaresBefore(const Eigen::VectorXd& x) const {
    return ResidualBefore(PredictBefore(x, 0), x).squaredNorm();
  }

  /// Of the log posterior, numbers first.
  Normal NormalAt(const Point& at, const Eigen::VectorXd& x, const Eigen::VectorXd& z) const {
    const Eigen::Index n = x.size(), m = z.size();
    Normal normal{at.J.transpose() * at.J, at.J.transpose() * at.residual};
    if (at.residual_before.size() > 0) {
      normal.A.topLeftCorner(n, n) += at.J_before.transpose() * at.J_before;
      normal.b.head(n) += at.J_before.transpose() * at.residual_before;
    } else {
      normal.A.topLeftCorner(n, n) += learned_.precision;
      normal.b.head(n) -= learned_.precision * (x - learned_.x);
    }
    normal.A.diagonal().tail(m).array() += 1;
    normal.b.tail(m) -= z;
    return normal;
  }

  double Squares(const Eigen::VectorXd& residual, const Eigen::VectorXd& x, const Eigen::VectorXd& z,
                 bool joint) const {
    const Eigen::VectorXd moved = x - learned_.x;
    const double of_numbers = joint ? SquaresBefore(x) : moved.dot(learned_.precision * moved);
    return residual.squaredNorm() + of_numbers + z.squaredNorm();
  }

  /// The discrepancy's size integrated out: a scaled inverse chi-square prior about that from before.
  double LogEvidence(double squares, double log_occam) const {
    const double freedom = states_ * after_.channels(), sure = kSureStates * after_.channels();
    return -0.5 * (freedom + sure) * std::log((squares + sure) / (freedom + sure)) + log_occam;
  }

  /// Log of the share of z's prior volume that remains, by the numbers' and z's curvature.
  static double LogOccam(const Eigen::MatrixXd& precision_of_z) {
    const Eigen::LLT<Eigen::MatrixXd> factor(precision_of_z);
    return -factor.matrixLLT().diagonal().array().log().sum();
  }

  /// Every change by one step from none, with the numbers following.
  void Screen(const Point& at, const Normal& numbers) {
    const Eigen::LDLT<Eigen::MatrixXd> solved(numbers.A);
    const Eigen::VectorXd x_step = solved.solve(numbers.b);
    const double squares0 = at.residual.squaredNorm() - numbers.b.dot(x_step);
    std::vector<Eigen::VectorXd> effects;  // what each changes, of those with one parameter
    for (const auto& [c, Jz] : SlopesOfChanges()) {
      const PostureChange& change = out_.changes[c];
      if (Jz.cwiseAbs().maxCoeff() == 0) continue;  // these states do not show it
      if (change.number && IsOneOf(effects, Jz.col(0))) continue;
      if (change.effect && Jz.cols() == 1) effects.push_back(Jz.col(0));
      Eigen::MatrixXd A = Jz.transpose() * Jz;
      A.diagonal().array() += 1;
      const Eigen::MatrixXd mixed = at.J.transpose() * Jz;
      A -= mixed.transpose() * solved.solve(mixed);
      const Eigen::VectorXd b = Jz.transpose() * at.residual - mixed.transpose() * x_step;
      ChangeFit fit;
      fit.change = static_cast<int>(c);
      fit.z = change.Possible(A.ldlt().solve(b));
      fit.covariance = A.inverse();
      const double squares = squares0 - 2 * b.dot(fit.z) + fit.z.dot(A * fit.z);
      fit.log_evidence = LogEvidence(squares, LogOccam(A) + change.LogOneSided());
      if (std::isfinite(fit.log_evidence)) out_.fits.push_back(std::move(fit));
    }
  }

  /// A number that does what an effect does is that effect: the core's radius is the bending stiffness.
  static bool IsOneOf(const std::vector<Eigen::VectorXd>& effects, const Eigen::VectorXd& slope) {
    constexpr double kSameCosine = 0.999;
    return std::any_of(effects.begin(), effects.end(), [&](const Eigen::VectorXd& effect) {
      return std::abs(effect.dot(slope)) > kSameCosine * effect.norm() * slope.norm();
    });
  }

  /// Whitened, a column each parameter, of every change that a robot can have; all about the same equilibria.
  std::vector<std::pair<std::size_t, Eigen::MatrixXd>> SlopesOfChanges() const {
    std::vector<std::pair<std::size_t, int>> parameters;  // change, and index of one of its parameters
    for (std::size_t c = 0; c < out_.changes.size(); ++c) {
      if (!IsPossible(out_.changes[c])) continue;
      for (int k = 0; k < out_.changes[c].size(); ++k) parameters.emplace_back(c, k);
    }
    const auto robot = [&](const Eigen::VectorXd& z) {
      PostureRobot its = learned_.RobotAt(learned_.x);
      for (std::size_t p = 0; p < parameters.size(); ++p) {
        const double value = z[static_cast<Eigen::Index>(p)];
        if (value != 0) Apply(out_.changes[parameters[p].first], parameters[p].second, value, its);
      }
      return its;
    };
    const auto count = static_cast<int>(parameters.size());
    const Predicted at = Predict(robot, Eigen::VectorXd::Zero(count), count, after_, options_.threads);
    std::vector<std::pair<std::size_t, Eigen::MatrixXd>> slopes;
    for (std::size_t p = 0; p < parameters.size();) {
      const std::size_t c = parameters[p].first;
      std::vector<Eigen::MatrixXd> its;
      for (int k = 0; k < out_.changes[c].size(); ++k) its.push_back(at.slopes[p++]);
      slopes.emplace_back(c, learned_.discrepancy.Whitened(its));
    }
    return slopes;
  }

  static void Apply(const PostureChange& change, int parameter, double z, PostureRobot& robot) {
    Eigen::VectorXd of = Eigen::VectorXd::Zero(change.size());
    of[parameter] = z;
    change.apply(robot, of);
  }

  /// There are robots with a little of it, with the same strains.
  bool IsPossible(const PostureChange& change) const {
    constexpr double kLittle = 1e-3;
    const PostureRobot before = learned_.RobotAt(learned_.x);
    const int strains = model::Body(before.robot.body).dof();
    try {
      for (int k = 0; k < change.size(); ++k) {
        PostureRobot its = before;
        Apply(change, k, kLittle, its);
        if (model::Body(its.robot.body).dof() != strains) return false;
      }
    } catch (const std::exception&) {
      return false;
    }
    return true;
  }

  /// Numbers and parameters at their joint maximum. The numbers' posterior counts as the quadratic about its
  /// maximum, or where that is not true any more by the states before, predicted with the numbers there.
  ChangeFit Refined(const PostureChange* change, Eigen::VectorXd x, Eigen::VectorXd z) const {
    constexpr double kTrue = 2;  // of the quadratic, in twice the log
    z *= 0.5;                    // the step from no change often goes too far
    Point at = begin_;
    at.J.conservativeResize(Eigen::NoChange, x.size() + z.size());
    UpdateParameters(change, x, z, at);
    double squares = ToMaximum(change, at, x, z, false);
    const double quadratic = (x - learned_.x).dot(learned_.precision * (x - learned_.x));
    if (!IsHopeless(change, at.residual.squaredNorm() + z.squaredNorm()) &&
        std::abs(SquaresBefore(x) - quadratic) > kTrue) {
      AddBefore(x, at, true);
      squares = ToMaximum(change, at, x, z, true);
    }
    return Summarised(change, at, x, z, squares);
  }

  /// Whether another change explains all that matters, and this one would be less likely even if its numbers
  /// cost nothing.
  bool IsHopeless(const PostureChange* change, double squares) const {
    return change != nullptr && best_explains_ &&
           LogEvidence(squares, change->LogOneSided()) < best_log_evidence_ - kSame;
  }

  bool Explains(const ChangeFit& fit) const {
    for (int p = 0; p < static_cast<int>(after_.points.size()); ++p) {
      if (HasExcess(learned_, fit.held_out_m, p, options_.delta_m)) return false;
    }
    return true;
  }

  /// The numbers' slopes hold for a few steps, at first those of the robot from before: most of the time goes
  /// into them. Returns the squares there; `at` has the slopes.
  double ToMaximum(const PostureChange* change, Point& at, Eigen::VectorXd& x, Eigen::VectorXd& z,
                   bool joint) const {
    constexpr int kRounds = 6, kSteps = 5;
    constexpr double kNearly = 0.02;
    double squares = Squares(at.residual, x, z, joint);
    for (int round = 0; round < kRounds; ++round) {
      const double before = squares;
      for (int step = 0; step < kSteps; ++step) {
        const double gained = StepFrom(change, at, x, z, squares, joint);
        if (gained < kNearly) break;
        UpdateParameters(change, x, z, at);
        if (joint) AddBefore(x, at, false);
      }
      if (round > 0 && squares == before) break;
      at = PointAt(change, x, z);
      if (joint) AddBefore(x, at, true);
      if (round > 0 && before - squares < kNearly) break;
    }
    return squares;
  }

  /// Infinite where there is no such robot.
  double SquaresAt(const PostureChange* change, const Eigen::VectorXd& x, const Eigen::VectorXd& z,
                   bool joint) const {
    try {
      return Squares(learned_.discrepancy.Whitened(measured_ - At(change, x, z, 0).channels_m), x, z, joint);
    } catch (const std::invalid_argument&) {
      return std::numeric_limits<double>::infinity();
    }
  }

  /// Moves to the first shorter and shorter step that is better; by how much.
  double StepFrom(const PostureChange* change, const Point& at, Eigen::VectorXd& x, Eigen::VectorXd& z,
                  double& squares, bool joint) const {
    const Normal normal = NormalAt(at, x, z);
    const Eigen::VectorXd way = normal.A.ldlt().solve(normal.b);
    for (double share = 1; share > 0.02; share /= 3) {
      const Eigen::VectorXd x1 = x + share * way.head(x.size());
      Eigen::VectorXd z1 = z + share * way.tail(z.size());
      if (change != nullptr) z1 = change->Possible(z1);
      const double there = SquaresAt(change, x1, z1, joint);
      if (!(there < squares)) continue;
      const double gained = squares - there;
      x = x1;
      z = z1;
      squares = there;
      return gained;
    }
    return 0;
  }

  /// The prediction and the slopes of the change's own parameters at (x, z); those of the numbers stay.
  void UpdateParameters(const PostureChange* change, const Eigen::VectorXd& x, const Eigen::VectorXd& z,
                        Point& at) const {
    const Eigen::Index m = z.size();
    const auto robot = [&](const Eigen::VectorXd& of) {
      PostureRobot its = learned_.RobotAt(x);
      if (change != nullptr) change->apply(its, of);
      return its;
    };
    const Predicted here = Predict(robot, z, static_cast<int>(m), after_, options_.threads);
    at.residual = learned_.discrepancy.Whitened(measured_ - here.channels_m);
    if (m > 0) at.J.rightCols(m) = learned_.discrepancy.Whitened(here.slopes);
  }

  ChangeFit Summarised(const PostureChange* change, const Point& at, const Eigen::VectorXd& x,
                       const Eigen::VectorXd& z, double squares) const {
    const Eigen::Index m = z.size();
    ChangeFit fit;
    fit.z = z;
    const Normal normal = NormalAt(at, x, z);
    double log_occam = 0;
    if (m > 0) {
      const Eigen::MatrixXd inverse = normal.A.inverse();
      const double sure = kSureStates * after_.channels();
      const double scale = (squares + sure) / (states_ * after_.channels() + sure);
      fit.covariance = std::max(1.0, scale) * inverse.bottomRightCorner(m, m);
      log_occam = LogOccam(inverse.bottomRightCorner(m, m).inverse()) + change->LogOneSided();
    }
    fit.log_evidence = LogEvidence(squares, log_occam);
    if (change != nullptr) fit.moves = Moves(at.predicted.channels_m - At(nullptr, x, {}, 0).channels_m);
    fit.held_out_m = HeldOut(at, normal);
    return fit;
  }

  /// The largest rms move of a point, over the least that matters.
  double Moves(const Eigen::MatrixXd& moved_m) const {
    double most = 0;
    for (int p = 0; p < static_cast<int>(after_.points.size()); ++p)
      most = std::max(most, PointRms(moved_m, p) / LeastThatMatters(learned_, p, options_.delta_m));
    return most;
  }

  /// Each quarter with the numbers and parameters that the others give, one step from the common maximum.
  Eigen::MatrixXd HeldOut(const Point& at, const Normal& normal) const {
    Eigen::MatrixXd left = measured_ - at.predicted.channels_m;
    const Eigen::Index channels = measured_.cols();
    for (int quarter = 0; quarter < kQuarters; ++quarter) {
      const auto [first, count] = QuarterOf(quarter, measured_.rows());
      const auto J = at.J.middleRows(first * channels, count * channels);
      const auto r = at.residual.segment(first * channels, count * channels);
      const Eigen::VectorXd moved = (normal.A - J.transpose() * J).ldlt().solve(normal.b - J.transpose() * r);
      for (Eigen::Index k = 0; k < moved.size(); ++k) {
        left.middleRows(first, count) -=
            moved[k] * at.predicted.slopes[static_cast<std::size_t>(k)].middleRows(first, count);
      }
    }
    return left;
  }

  /// Evidence of a change that is no hypothesis of the library: each whitened channel shifted by a function
  /// of the motors' angles of second order, whose size the data choose; the numbers are free as beside any
  /// other.
  double Unlisted(const Point& at, const Normal& numbers) const {
    const Eigen::MatrixXd basis = Basis();
    const Eigen::Index n = at.J.cols(), channels = measured_.cols(), functions = basis.cols() * channels;
    Eigen::MatrixXd J = Eigen::MatrixXd::Zero(at.J.rows(), n + functions);
    J.leftCols(n) = at.J;
    for (Eigen::Index state = 0; state < basis.rows(); ++state) {
      for (Eigen::Index c = 0; c < channels; ++c)
        J.row(state * channels + c).segment(n + c * basis.cols(), basis.cols()) = basis.row(state);
    }
    Eigen::MatrixXd information = Eigen::MatrixXd::Zero(n + functions, n + functions);
    information.selfadjointView<Eigen::Lower>().rankUpdate(J.transpose());
    information.topLeftCorner(n, n) = numbers.A;
    const Eigen::VectorXd pull = J.transpose() * at.residual;
    const double of_numbers = LogDeterminant(numbers.A);
    std::vector<double> log_evidences;  // with sizes between which none is preferred
    for (double variance = 1e-4; variance < 1e6; variance *= 10) {
      Eigen::MatrixXd A = information;
      A.diagonal().tail(functions).array() += 1 / variance;
      const Eigen::LDLT<Eigen::MatrixXd> solved(A.selfadjointView<Eigen::Lower>());
      const double squares = at.residual.squaredNorm() - pull.dot(solved.solve(pull));
      const double volume = static_cast<double>(functions) * std::log(variance);
      const double occam = 0.5 * (of_numbers - solved.vectorD().array().log().sum() - volume);
      log_evidences.push_back(LogEvidence(squares, occam));
    }
    const double best = *std::max_element(log_evidences.begin(), log_evidences.end());
    double sum = 0;
    for (const double log : log_evidences) sum += std::exp(log - best);
    return best + std::log(sum / static_cast<double>(log_evidences.size()));
  }

  static double LogDeterminant(const Eigen::MatrixXd& of) {
    return Eigen::LDLT<Eigen::MatrixXd>(of).vectorD().array().log().sum();
  }

  /// S x functions: constant, angles of unit rms, and their products.
  Eigen::MatrixXd Basis() const {
    const Eigen::MatrixXd angles = after_.Stacked(&States::motor_rad);
    // Motors that turn together are one.
    const Eigen::MatrixXd centred = angles.rowwise() - angles.colwise().mean();
    const Eigen::JacobiSVD<Eigen::MatrixXd> svd(centred, Eigen::ComputeThinU);
    const Eigen::Index rank = (svd.singularValues().array() > 1e-3 * svd.singularValues()[0]).count();
    const Eigen::MatrixXd free = std::sqrt(static_cast<double>(angles.rows())) * svd.matrixU().leftCols(rank);
    Eigen::MatrixXd basis(angles.rows(), 1 + rank + rank * (rank + 1) / 2);
    basis.col(0).setOnes();
    basis.middleCols(1, rank) = free;
    Eigen::Index column = 1 + rank;
    for (Eigen::Index a = 0; a < rank; ++a) {
      for (Eigen::Index b = a; b < rank; ++b) basis.col(column++) = free.col(a).cwiseProduct(free.col(b));
    }
    return basis;
  }

  const LearnedPostures& learned_;
  const int every_;  // of the states before that say the same; one of them stands for all
  const Postures before_;
  const Postures& after_;
  const ChangeOptions& options_;
  const Discrepancy noise_before_;
  const Eigen::MatrixXd learned_before_m_;  // the states before as the learned robot has them
  const Eigen::MatrixXd measured_;
  double states_ = 0;                       // independent ones
  Point begin_;                             // the robot from before
  double best_log_evidence_ = kNoEvidence;  // of the changes refined so far
  bool best_explains_ = false;
  ChangeFit none_;  // nothing changed
  ChangeSearch out_;
};

}  // namespace

std::vector<PostureChange> PostureChanges(const RobotParameters& robot,
                                          const std::vector<std::string>& without) {
  std::vector<PostureChange> changes;
  for (const Candidate& candidate : AllCandidates(robot, false, true)) {
    if (std::find(without.begin(), without.end(), candidate.effect->name) != without.end()) continue;
    // The motor of a pair's second tendon is the first's.
    if (IsOfMotor(*candidate.effect) && candidate.target && !robot.actuation->HasDrive(*candidate.target))
      continue;
    if (auto change = ChangeOf(candidate)) changes.push_back(std::move(*change));
  }
  for (const FileNumber& number : FileNumbers(robot)) {
    if (number.effect.empty() && number.tendon == 0) changes.push_back(ChangeOf(number));
  }
  return changes;
}

double LeastThatMatters(const LearnedPostures& learned, int point, double delta_m) {
  constexpr double kOfFloor = 0.5;
  return std::max(delta_m, kOfFloor * learned.Floor(point));
}

double Excess(const LearnedPostures& learned, const Eigen::MatrixXd& residuals_m, int point) {
  const double rms = PointRms(residuals_m, point), floor = learned.Floor(point);
  return std::sqrt(std::max(0.0, rms * rms - floor * floor));
}

bool HasExcess(const LearnedPostures& learned, const Eigen::MatrixXd& residuals_m, int point,
               double delta_m) {
  return Excess(learned, residuals_m, point) > LeastThatMatters(learned, point, delta_m);
}

ChangeSearch SearchChange(const LearnedPostures& learned, const RobotParameters& file, const Postures& before,
                          const Postures& after, const ChangeOptions& options) {
  return Searching(learned, file, before, after, options).Result();
}

}  // namespace tendril::gap
