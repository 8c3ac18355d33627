// Describes each number of the robot file; a fit follows it from the file's value in the direction that
// helps, in doubling steps.
#include "file_numbers.h"

#include <fmt/core.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <numbers>
#include <set>
#include <string_view>
#include <utility>

#include "tendril/core/parallel.h"

namespace tendril::gap {
namespace {

/// Where in the chain a number is.
struct Place {
  sim::Stage stage{};
  sim::Element element = sim::Element::kAny;
};

/// A number that every `Part` of the robot has; `each(robot, call)` calls with each of them.
template <class Part, class Each>
void AddFactor(const RobotParameters& robot, std::string key, Place place, double Part::*number, Each each,
               std::vector<FileNumber>& all) {
  double first = 0;
  RobotParameters copy = robot;
  each(copy, [&](Part& part) {
    if (first == 0) first = part.*number;
  });
  if (first == 0) return;
  all.push_back({std::move(key), first, false, place.stage, place.element,
                 [=](RobotParameters& changed, double change) {
                   each(changed, [&](Part& part) { part.*number *= std::exp(change); });
                 }});
}

void AddBody(const RobotParameters& robot, std::vector<FileNumber>& all) {
  constexpr Place kBody{sim::Stage::kBody};
  const auto sections = [](RobotParameters& r, const auto& call) {
    for (SectionParameters& section : r.body.sections) call(section);
  };
  const auto routes = [](RobotParameters& r, const auto& call) {
    for (SectionParameters& section : r.body.sections) {
      for (TendonRoute& route : section.tendons) call(route);
    }
  };
  const auto section = [&](const char* key, double SectionParameters::*number) {
    AddFactor(robot, fmt::format("body.sections.{}", key), kBody, number, sections, all);
  };
  section("unit_length_m", &SectionParameters::unit_length_m);
  section("youngs_modulus_Pa", &SectionParameters::youngs_modulus_Pa);
  section("core_radius_m", &SectionParameters::core_radius_m);
  section("bending_damping_Nms", &SectionParameters::bending_damping_Nms);
  const std::size_t before_inertia = all.size();
  section("disk_inertia_xx_kgm2", &SectionParameters::disk_inertia_xx_kgm2);
  section("disk_inertia_zz_kgm2", &SectionParameters::disk_inertia_zz_kgm2);
  for (std::size_t n = before_inertia; n < all.size(); ++n) all[n].may_be_open = false;
  // A disk's inertia follows from its mass if the file gives its diameter.
  const double mass_kg = robot.body.sections.front().unit_mass_kg;
  all.push_back({"body.sections.unit_mass_kg", mass_kg, false, kBody.stage, kBody.element,
                 [](RobotParameters& r, double change) {
                   for (SectionParameters& s : r.body.sections) {
                     for (double* x : {&s.unit_mass_kg, &s.disk_inertia_xx_kgm2, &s.disk_inertia_zz_kgm2})
                       *x *= std::exp(change);
                   }
                 }});
  AddFactor(robot, "body.sections.tendons.radius_m", kBody, &TendonRoute::radius_m, routes, all);
  if (robot.body.gravity_W_mps2.norm() > 0) {
    all.push_back({"body.gravity_W_mps2", robot.body.gravity_W_mps2.norm(), false, kBody.stage, kBody.element,
                   [](RobotParameters& r, double change) { r.body.gravity_W_mps2 *= std::exp(change); }});
  }
  int tendon = 0;
  for (std::size_t k = 0; k < robot.body.sections.size(); ++k) {
    for (std::size_t j = 0; j < robot.body.sections[k].tendons.size(); ++j, ++tendon) {
      const auto route = [k, j](RobotParameters& r, const auto& call) {
        call(r.body.sections[k].tendons[j]);
      };
      const std::string key = fmt::format("body.sections.tendons (tendon {}) ", tendon + 1);
      const std::size_t before = all.size();
      AddFactor(robot, key + "radius_m", kBody, &TendonRoute::radius_m, route, all);
      all.push_back({key + "angle_rad", robot.body.sections[k].tendons[j].angle_rad, true, kBody.stage,
                     kBody.element, [route](RobotParameters& r, double change) {
                       route(r, [&](TendonRoute& t) { t.angle_rad += change; });
                     }});
      for (std::size_t n = before; n < all.size(); ++n) all[n].tendon = tendon + 1;
    }
  }
}

/// Changes the encoder counts. The runs' angles were computed with the file's counts, so a wrong count scales
/// them: this is equivalent to a different spool travel per radian, and to torques, inertia and angles of a
/// motor behind a gear of that ratio.
void RecountMotor(TendonDriveParameters& drive, double change) {
  const double turned = std::exp(change);  // angle in the runs over the motor's true angle
  drive.spool.radius_m /= turned;
  drive.motor.torque_scale /= turned;
  drive.motor.coulomb_friction_Nm /= turned;
  drive.motor.coulomb_damping_Nms /= turned;
  drive.motor.viscous_friction_Nms /= turned * turned;
  drive.motor.rotor_inertia_kgm2 /= turned * turned;
  drive.motor.coulomb_angle_rad *= turned;
  for (double& yield : drive.gear.presliding_yields_rad) yield *= turned;
}

/// Readings are newtons by the file's gain, so another gain shows relative to it: as the effect does.
void AddCellGain(const RobotParameters& robot, std::vector<FileNumber>& all) {
  constexpr const char* kKey = "actuation.load_cell.gain_VpN";
  const LoadCellParameters& first = robot.actuation->tendons.front().load_cell;
  if (first.place == LoadCellPlace::kNone || first.gain_VpN == 0) return;
  const sim::Effect& effect = *sim::FindEffectOfNumber(kKey);
  const std::string name(effect.name), scale = effect.parameters.front().name;
  all.push_back({kKey, first.gain_VpN, false, sim::Stage::kSensor, sim::Element::kAny,
                 [name, scale](RobotParameters& changed, double change) {
                   changed.effects.push_back({name, "all", {{scale, std::exp(change)}}});
                 }});
}

/// The gear's yields are a list, wrong by one factor.
void AddPresliding(const RobotParameters& robot, std::vector<FileNumber>& all) {
  const std::vector<double>& yields = robot.actuation->tendons.front().gear.presliding_yields_rad;
  if (yields.empty()) return;
  all.push_back({"actuation.gear.presliding_yields_rad", yields.front(), false, sim::Stage::kDrive,
                 sim::Element::kAny, [](RobotParameters& changed, double change) {
                   for (TendonDriveParameters& drive : changed.actuation->tendons) {
                     for (double& yield : drive.gear.presliding_yields_rad) yield *= std::exp(change);
                   }
                 }});
  all.back().may_be_open = false;
}

void AddActuation(const RobotParameters& robot, std::vector<FileNumber>& all) {
  constexpr Place kDrive{sim::Stage::kDrive}, kTransmission{sim::Stage::kTransmission},
      kTendon{sim::Stage::kTransmission, sim::Element::kTendon},
      kPulleys{sim::Stage::kTransmission, sim::Element::kPulleys}, kSensor{sim::Stage::kSensor};
  const int counts = robot.actuation->tendons.front().drive.encoder_counts_per_turn;
  all.push_back({"actuation.drive.encoder_counts_per_turn", static_cast<double>(counts), false, kSensor.stage,
                 kSensor.element, [](RobotParameters& changed, double change) {
                   for (TendonDriveParameters& drive : changed.actuation->tendons)
                     RecountMotor(drive, change);
                 }});
  all.back().may_be_open = false;
  const auto part = [&](const char* key, Place place, auto TendonDriveParameters::*member, auto number) {
    AddFactor(
        robot, fmt::format("actuation.{}", key), place, number,
        [member](RobotParameters& r, const auto& call) {
          for (TendonDriveParameters& drive : r.actuation->tendons) call(drive.*member);
        },
        all);
  };
  using Drive = TendonDriveParameters;
  part("motor.torque_constant_NmpA", kDrive, &Drive::motor, &MotorParameters::torque_scale);
  all.back().in_file *= robot.actuation->tendons.front().motor.torque_constant_NmpA;
  part("motor.rotor_inertia_kgm2", kDrive, &Drive::motor, &MotorParameters::rotor_inertia_kgm2);
  part("motor.coulomb_friction_Nm", kDrive, &Drive::motor, &MotorParameters::coulomb_friction_Nm);
  part("motor.coulomb_angle_rad", kDrive, &Drive::motor, &MotorParameters::coulomb_angle_rad);
  part("motor.viscous_friction_Nms", kDrive, &Drive::motor, &MotorParameters::viscous_friction_Nms);
  part("motor.torque_lag_s", kDrive, &Drive::motor, &MotorParameters::torque_lag_s);
  part("gear.ratio", kTransmission, &Drive::gear, &GearParameters::ratio);
  part("gear.efficiency", kDrive, &Drive::gear, &GearParameters::efficiency);
  AddPresliding(robot, all);
  part("spool.radius_m", kTransmission, &Drive::spool, &SpoolParameters::radius_m);
  part("tendon.stiffness_Npm", kTendon, &Drive::tendon, &TendonParameters::stiffness_Npm);
  part("tendon.damping_Nspm", kTendon, &Drive::tendon, &TendonParameters::damping_Nspm);
  AddCellGain(robot, all);
  part("transmission.presliding_m", kTransmission, &Drive::transmission,
       &TransmissionParameters::presliding_m);
  const auto pulley = [&](const char* key, double PulleyParameters::*number) {
    AddFactor(
        robot, fmt::format("actuation.transmission.pulleys.{}", key), kPulleys, number,
        [](RobotParameters& r, const auto& call) {
          for (TendonDriveParameters& drive : r.actuation->tendons) {
            for (PulleyParameters& p : drive.transmission.pulleys) call(p);
          }
        },
        all);
  };
  pulley("wrap_rad", &PulleyParameters::wrap_rad);
  pulley("radius_ratio", &PulleyParameters::radius_ratio);
  pulley("alpha", &PulleyParameters::alpha);
  pulley("exponent", &PulleyParameters::exponent);
}

/// Log score of one number as a function of its change, on some or all runs, with the nuisances free.
class Scored {
 public:
  Scored(const Evaluator& evaluator, const Weights& weights, const Nuisances& nuisances, const Folds& folds)
      : evaluator_(evaluator), weights_(weights), nuisances_(nuisances), folds_(folds) {
    nuisances.AddTo(columns_, bounds_);
  }

  /// -infinity where that robot cannot be simulated.
  double At(const FileNumber& number, double change, const std::vector<int>& runs,
            Residuals* residuals = nullptr) const {
    try {
      RobotParameters robot = evaluator_.nominal();
      number.apply(robot, change);
      Residuals at =
          Completed(evaluator_.At(robot, evaluator_.CutsBehind(number.stage, number.element), runs),
                    evaluator_.AtNominal());
      for (const auto& run : at) {
        for (const auto& channel : run) {
          if (!channel.allFinite()) return -INFINITY;
        }
      }
      double score = LogScore(weights_, at, evaluator_.AtNominal());
      Eigen::VectorXd moved;
      if (!columns_.empty()) {
        const LinearFit fit =
            SolveLinear(Accumulate(columns_, at, evaluator_.AtNominal(), weights_, folds_), bounds_);
        score += fit.score;
        moved = fit.value;
      }
      if (residuals != nullptr) *residuals = Without(std::move(at), moved);
      return score;
    } catch (const std::exception&) {
      return -INFINITY;
    }
  }

 private:
  Residuals Without(Residuals at, const Eigen::VectorXd& moved) const {
    for (std::size_t k = 0; k < columns_.size(); ++k) {
      for (std::size_t i = 0; i < at.size(); ++i) {
        for (std::size_t c = 0; c < at[i].size() && !(*columns_[k])[i].empty(); ++c) {
          const Eigen::VectorXd& column = (*columns_[k])[i][c];
          if (column.size() > 0) at[i][c] -= moved[static_cast<Eigen::Index>(k)] * column;
        }
      }
    }
    return at;
  }

  const Evaluator& evaluator_;
  const Weights& weights_;
  const Nuisances& nuisances_;
  const Folds& folds_;
  std::vector<const Column*> columns_;
  Bounds bounds_;
};

/// A change and its score.
struct Point {
  double change = 0, score = -INFINITY;
};

/// Refines about a point by halving the step.
Point Refined(const std::function<double(double)>& score, Point best, double step, int halvings) {
  for (int k = 0; k < halvings; ++k, step /= 2) {
    for (const double change : {best.change - step, best.change + step}) {
      const Point next{change, score(change)};
      if (next.score <= best.score) continue;
      best = next;
      break;
    }
  }
  return best;
}

/// The best of doubling steps in both directions and of the `slips`, refined. The first steps are always
/// taken, since the score may fall before it rises for a number that is far off; later ones only while the
/// score does not fall. Between the right value and one of another unit the robot may be of no use, so a slip
/// is tried as it is.
Point Followed(const std::function<double(double)>& score, const Point& start, double first_step, double most,
               const std::vector<double>& slips, int halvings) {
  constexpr double kAnyway = 1;  // a factor of e, or a radian
  Point best = start;
  for (const double slip : slips) {
    const Point next{slip, score(slip)};
    if (next.score > best.score) best = next;
  }
  for (const int sign : {1, -1}) {
    double last = start.score;
    for (double step = first_step; step <= most; step *= 2) {
      const Point next{sign * step, score(sign * step)};
      if (step > kAnyway && next.score < last) break;
      last = next.score;
      if (next.score > best.score) best = next;
    }
  }
  return best.change == 0 ? best : Refined(score, best, std::abs(best.change) / 2, halvings);
}

/// The shortest run of each family, up to three.
std::vector<int> FewRuns(const Evaluator& evaluator) {
  constexpr std::size_t kRuns = 3;
  std::vector<int> order(evaluator.runs().size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = static_cast<int>(i);
  const auto& runs = evaluator.runs();
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    return runs[static_cast<std::size_t>(a)].samples() < runs[static_cast<std::size_t>(b)].samples();
  });
  std::set<std::string> families;
  std::stable_partition(order.begin(), order.end(), [&](int i) {
    return families.insert(runs[static_cast<std::size_t>(i)].family).second;
  });
  order.resize(std::min(kRuns, order.size()));
  return order;
}

/// Of these runs the one with the largest gap: there a wrong number shows most.
int MostTelling(const Evaluator& evaluator, const Weights& weights, const std::vector<int>& runs) {
  const auto gap = [&](int i) {
    double sum = 0;
    const auto& residuals = evaluator.AtNominal()[static_cast<std::size_t>(i)];
    for (std::size_t c = 0; c < residuals.size(); ++c)
      sum += (weights(i, static_cast<int>(c)).array() * residuals[c].array().square()).sum();
    return sum;
  };
  return *std::max_element(runs.begin(), runs.end(), [&](int a, int b) { return gap(a) < gap(b); });
}

/// The `most` with the highest score, the best first.
void KeepBest(std::size_t most, std::vector<std::pair<FileNumber, Point>>& numbers) {
  std::stable_sort(numbers.begin(), numbers.end(),
                   [](const auto& a, const auto& b) { return a.second.score > b.second.score; });
  numbers.resize(std::min(numbers.size(), most));
}

/// Model discrepancy per channel for following a number that is far off: that of the worst channel, in noise
/// floors, in all of them. With its own discrepancy, a channel that the wrong model happens to reproduce (a
/// body too stiff to bend does not ring either) would count against every step towards the right value.
Eigen::VectorXd WorstDiscrepancyEverywhere(const Evaluator& evaluator, Eigen::VectorXd leftover) {
  const auto& channels = evaluator.channels();
  double most = 0;
  for (std::size_t c = 0; c < channels.size(); ++c)
    most = std::max(most, leftover[static_cast<Eigen::Index>(c)] / channels[c].floor);
  for (std::size_t c = 0; c < channels.size(); ++c)
    leftover[static_cast<Eigen::Index>(c)] = most * channels[c].floor;
  return leftover;
}

}  // namespace

std::string WithoutTendon(const std::string& key) {
  const auto begin = key.find(" (tendon ");
  if (begin == std::string::npos) return key;
  return fmt::format("{}.{}", key.substr(0, begin), key.substr(key.find(") ", begin) + 2));
}

double FileNumber::ValueAt(double change) const {
  return angle ? in_file + change : in_file * std::exp(change);
}

double FileNumber::ChangeTo(double value) const {
  return angle ? value - in_file : std::log(value / in_file);
}

std::vector<FileNumber> FileNumbers(const RobotParameters& robot) {
  std::vector<FileNumber> all;
  AddBody(robot, all);
  if (robot.actuation) AddActuation(robot, all);
  for (FileNumber& number : all) {
    const sim::Effect* effect = sim::FindEffectOfNumber(WithoutTendon(number.key));
    if (effect != nullptr) number.effect = effect->name;
  }
  return all;
}

std::vector<NumberFit> FitNumbers(const Evaluator& evaluator, const Eigen::VectorXd& leftover,
                                  const Nuisances& nuisances, const Folds& folds, int count, int threads,
                                  const std::function<void(double)>& progress) {
  // From a fifth to three orders of magnitude, such as a missing milli; angles up to half a turn.
  constexpr double kFirstStep = 0.2, kMost = 7, kFirstStep_rad = 0.1, kMost_rad = std::numbers::pi;
  const double milli = std::log(1e-3);
  constexpr int kCoarse = 2, kMiddle = 1, kFine = 6;
  // A race: every number on one run, the first of them on a few, the best on all. A right number explains
  // nearly all of any run, so it is far from the last on one.
  const std::size_t raced = 3 * static_cast<std::size_t>(count);
  const Weights coarse_weights(evaluator, WorstDiscrepancyEverywhere(evaluator, leftover)),
      weights(evaluator, leftover);
  const Scored followed(evaluator, coarse_weights, nuisances, folds),
      scored(evaluator, weights, nuisances, folds);
  const std::vector<int> few = FewRuns(evaluator), every{},
                         telling{MostTelling(evaluator, coarse_weights, few)};
  std::vector<std::pair<FileNumber, Point>> entered;
  for (const FileNumber& number : FileNumbers(evaluator.nominal())) entered.push_back({number, {}});
  const double at_nominal = followed.At(entered.front().first, 0, telling);
  std::atomic<int> done{0};
  ParallelFor(static_cast<int>(entered.size()), threads, [&](int k) {
    auto& [number, best] = entered[static_cast<std::size_t>(k)];
    const auto score = [&, &changed = number](double change) {
      return followed.At(changed, change, telling);
    };
    best = Followed(score, {0, at_nominal}, number.angle ? kFirstStep_rad : kFirstStep,
                    number.angle ? kMost_rad : kMost,
                    number.angle ? std::vector<double>{} : std::vector{milli, -milli}, kCoarse);
    if (progress) progress(0.6 * ++done / static_cast<double>(entered.size()));
  });
  std::erase_if(entered, [](const auto& one) { return one.second.change == 0; });
  KeepBest(raced, entered);
  ParallelFor(static_cast<int>(entered.size()), threads, [&](int k) {
    auto& [number, best] = entered[static_cast<std::size_t>(k)];
    const auto score = [&, &changed = number](double change) { return followed.At(changed, change, few); };
    best = Refined(score, {best.change, score(best.change)}, std::abs(best.change) / 4, kMiddle);
  });
  KeepBest(static_cast<std::size_t>(count), entered);
  if (progress) progress(0.8);
  std::vector<NumberFit> fits(entered.size());
  ParallelFor(static_cast<int>(entered.size()), threads, [&](int k) {
    const auto& [number, about] = entered[static_cast<std::size_t>(k)];
    const auto score = [&](double change) { return scored.At(number, change, every); };
    const Point best = Refined(score, {about.change, score(about.change)}, std::abs(about.change) / 8, kFine);
    NumberFit& fit = fits[static_cast<std::size_t>(k)];
    fit.number = number;
    fit.value = number.ValueAt(best.change);
    fit.score = scored.At(number, best.change, every, &fit.residuals);
  });
  if (progress) progress(1);
  std::erase_if(fits, [](const NumberFit& fit) { return !std::isfinite(fit.score); });
  std::stable_sort(fits.begin(), fits.end(),
                   [](const NumberFit& a, const NumberFit& b) { return a.score > b.score; });
  return fits;
}

}  // namespace tendril::gap
