// One entry for each section, tendon and axis.
#include "numbers.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <initializer_list>

#include "../free_numbers.h"
#include "tendril/config/keys.h"
#include "tendril/model/capstan.h"

namespace tendril::gap {
namespace {

// Priors of what no file says.
constexpr double kZero = 0.25;          // of a tendon's zero, over its distance from the backbone: a bend
constexpr double kRestBend_rad = 0.15;  // of a section without load
constexpr double kTilt_rad = 0.05;      // of the base
constexpr double kAnyWay_rad = 1.5;     // of a base whose mount is unknown
constexpr double kLag_s = 0.1;
constexpr double kDrift = 1e-3;  // of a camera: 29.97 frames a second are often written 30
const Uncertainty kUnknown{Uncertainty::Kind::kUnknown, 0};
// Of a sheath that no file draws: its wrap, which takes a tenth of the tension, and the pull in which
// friction turns round, mostly by the tendon's stretch.
constexpr double kSheath_rad = 0.7, kSheathPresliding_m = 3e-4;
constexpr double kSheathWithin = 2;  // deviation of the wrap, in wraps: from none to a winding sheath's
constexpr double kPlaced = 0.01,
                 kPlaced_rad = 0.02;  // of a tracker placed with care: of the length, and turned
constexpr double kGuessed = 0.5, kGuessed_rad = 0.5;  // of one whose frame was read from the data

class Listing {
 public:
  Listing(const RobotParameters& robot, bool frame_is_known, const std::vector<PosturePoint>& points)
      : robot_(robot), known_(frame_is_known), points_(points) {}

  std::vector<PostureNumber> All() {
    for (std::size_t k = 0; k < robot_.body.sections.size(); ++k) OfSection(k);
    std::size_t tendon = 0;
    for (std::size_t k = 0; k < robot_.body.sections.size(); ++k) {
      for (std::size_t j = 0; j < robot_.body.sections[k].tendons.size(); ++j) OfTendon(k, j, tendon++);
    }
    OfSheaths();
    OfPresliding();
    OfMount();
    return std::move(all_);
  }

 private:
  /// What the file says of the first of these keys that it speaks of, else what is usual.
  Uncertainty Known(std::initializer_list<std::string> keys) const {
    for (const std::string& key : keys) {
      if (const auto found = robot_.uncertain.find(key); found != robot_.uncertain.end())
        return found->second;
    }
    return UsualUncertainty(*keys.begin());
  }

  /// A number of the file at `place`, a function that gives a reference to it.
  template <class Place>
  void Add(std::string key, const Uncertainty& known, bool additive, Place place) {
    RobotParameters copy = robot_;
    const double in_file = place(copy);
    const auto deviation = DeviationOf(in_file, additive, known);
    if (!deviation || (in_file == 0 && !additive)) return;
    const std::string unit = config::UnitOfKey(key.substr(key.find_last_of('.') + 1));
    all_.push_back({.key = std::move(key),
                    .unit = unit,
                    .deviation = *deviation,
                    .additive = additive,
                    .apply =
                        [place, additive](PostureRobot& robot, double change) {
                          double& number = place(robot.robot);
                          number = additive ? number + change : number * std::exp(change);
                        },
                    .value = [place](RobotParameters robot) { return place(robot); }});
  }
  /// One that no file holds; a change of 1 is `per_change` of its unit.
  void Add(std::string key, const char* unit, double per_change, double deviation,
           std::function<void(PostureRobot&, double)> apply) {
    all_.push_back({.key = std::move(key),
                    .unit = unit,
                    .deviation = deviation,
                    .additive = true,
                    .per_change = per_change,
                    .apply = std::move(apply)});
  }

  void OfSection(std::size_t k) {
    const SectionParameters& section = robot_.body.sections[k];
    const auto add = [&](const char* word, double& (*of)(SectionParameters&)) {
      const std::string key = fmt::format("body.sections[{}].{}", k + 1, word);
      Add(key, Known({key}), false,
          [k, of](RobotParameters& robot) -> double& { return of(robot.body.sections[k]); });
    };
    add("unit_length_m", [](SectionParameters& s) -> double& { return s.unit_length_m; });
    add("youngs_modulus_Pa", [](SectionParameters& s) -> double& { return s.youngs_modulus_Pa; });
    add("unit_mass_kg", [](SectionParameters& s) -> double& { return s.unit_mass_kg; });
    if (section.disk_mass_kg > 0)
      add("disk_mass_kg", [](SectionParameters& s) -> double& { return s.disk_mass_kg; });
    // A disk's inertia follows from its mass, or else the unit's, if the file gives its diameter.
    const char* its_mass = section.disk_mass_kg > 0 ? ".disk_mass_kg" : ".unit_mass_kg";
    if (!all_.empty() && all_.back().key.ends_with(its_mass)) {
      all_.back().apply = [k, mass = all_.back().apply](PostureRobot& robot, double change) {
        mass(robot, change);
        SectionParameters& its = robot.robot.body.sections[k];
        for (double* x : {&its.disk_inertia_xx_kgm2, &its.disk_inertia_zz_kgm2}) *x *= std::exp(change);
      };
    }
    if (section.extension && section.axial_stiffness_N)
      add("axial_stiffness_N", [](SectionParameters& s) -> double& { return *s.axial_stiffness_N; });
    if (section.torsion && section.torsional_stiffness_Nm2) {
      add("torsional_stiffness_Nm2",
          [](SectionParameters& s) -> double& { return *s.torsional_stiffness_Nm2; });
    }
    if (section.shear && section.shear_stiffness_N)
      add("shear_stiffness_N", [](SectionParameters& s) -> double& { return *s.shear_stiffness_N; });
    int first = 1;
    for (std::size_t i = 0; i < k; ++i) first += robot_.body.sections[i].units;
    const int units = section.units;
    for (double UnitDeviation::*bend : {&UnitDeviation::rest_u_rad, &UnitDeviation::rest_v_rad}) {
      Add(fmt::format("rest bend {} of section {}", bend == &UnitDeviation::rest_u_rad ? "u" : "v", k + 1),
          "rad", 1, kRestBend_rad, [first, units, bend](PostureRobot& robot, double change) {
            for (int unit = first; unit < first + units; ++unit)
              robot.robot.body.DeviationOf(unit).*bend += change / units;
          });
      all_.back().value = [first, units, bend](RobotParameters robot) {
        double sum = 0;
        for (int unit = first; unit < first + units; ++unit) sum += robot.body.DeviationOf(unit).*bend;
        return sum;
      };
    }
  }

  void OfTendon(std::size_t k, std::size_t j, std::size_t tendon) {
    const std::string hole = fmt::format("body.sections[{}].tendons[{}]", k + 1, j + 1);
    const auto add = [&](const char* word, bool angle, double TendonRoute::*number) {
      const std::string key = fmt::format("{}.{}", hole, word);
      Add(key, Known({key}), angle, [k, j, number](RobotParameters& robot) -> double& {
        return robot.body.sections[k].tendons[j].*number;
      });
    };
    add("angle_rad", true, &TendonRoute::angle_rad);
    add("radius_m", false, &TendonRoute::radius_m);
    const auto drive = [&](const char* word, double& (*of)(TendonDriveParameters&)) {
      const std::string own = fmt::format("actuation.per_tendon.{}.{}", tendon + 1, word);
      Add(own, Known({own, fmt::format("actuation.{}", word)}), false,
          [tendon, of](RobotParameters& robot) -> double& { return of(robot.actuation->tendons[tendon]); });
    };
    OfSpool(tendon);
    drive("tendon.stiffness_Npm", [](TendonDriveParameters& d) -> double& { return d.tendon.stiffness_Npm; });
    OfPath(tendon);
    const auto row = static_cast<Eigen::Index>(tendon);
    const double lever_m = robot_.body.sections[k].tendons[j].radius_m;
    Add(fmt::format("zero of tendon {}", tendon + 1), "m", lever_m, kZero,
        [row, lever_m](PostureRobot& robot, double change) { robot.zero_m[row] += lever_m * change; });
  }

  /// Of both tendons of a pair.
  void OfSpool(std::size_t tendon) {
    const ActuationParameters& actuation = *robot_.actuation;
    const auto j = static_cast<int>(tendon);
    if (!actuation.HasDrive(j)) return;
    const TendonPair* pair = actuation.PairOf(j);
    const std::size_t other = pair != nullptr ? static_cast<std::size_t>(pair->second) : tendon;
    const std::string own = fmt::format("actuation.per_tendon.{}.spool.radius_m", tendon + 1);
    AddFactor(own, "m", Known({own, "actuation.spool.radius_m"}), false, [=](RobotParameters& robot) {
      std::vector<double*> radii{&robot.actuation->tendons[tendon].spool.radius_m};
      if (other != tendon) radii.push_back(&robot.actuation->tendons[other].spool.radius_m);
      return radii;
    });
  }

  /// The friction coefficients of all that a tendon passes, as one.
  void OfPath(std::size_t tendon) {
    const std::string word = "transmission.pulleys[1].alpha";
    const std::string own = fmt::format("actuation.per_tendon.{}.{}", tendon + 1, word);
    const bool drawn = !robot_.actuation->tendons[tendon].transmission.pulleys.empty();
    const std::string of_sheath =
        fmt::format("friction coefficient of tendon {}'s sheath, against the others", tendon + 1);
    AddFactor(drawn ? own : of_sheath, "", drawn ? Known({own, "actuation." + word}) : UsualUncertainty(own),
              !drawn, [tendon](RobotParameters& robot) {
                return Frictions(robot.actuation->tendons[tendon].transmission);
              });
  }

  /// Sheaths of one robot are alike. Not a factor, since a path may well have no friction; what is learned
  /// may come out a little below that.
  void OfSheaths() {
    const std::vector<std::size_t> bare = Tendons(false);
    if (bare.empty()) return;
    all_.push_back({.key = "wrap of the sheaths",
                    .unit = "rad",
                    .deviation = kSheathWithin,
                    .additive = true,
                    .per_change = kSheath_rad,
                    .apply =
                        [bare](PostureRobot& robot, double change) {
                          for (const std::size_t j : bare)
                            for (PulleyParameters& sheath : Path(robot.robot, j).pulleys)
                              sheath.wrap_rad += kSheath_rad * change;
                        },
                    .value =
                        [first = bare.front()](RobotParameters robot) {
                          RobotParameters its = WithSheaths(std::move(robot));
                          return Path(its, first).pulleys.front().wrap_rad;
                        },
                    .assumed = true});
  }

  /// One for the tendons whose path is drawn, one for the others.
  void OfPresliding() {
    const std::string key = "actuation.transmission.presliding_m";
    for (const bool drawn : {true, false}) {
      const std::vector<std::size_t> tendons = Tendons(drawn);
      if (tendons.empty()) continue;
      AddFactor(drawn ? key : "pull in which the friction of the sheaths turns round", "m",
                drawn ? Known({key}) : kUnknown, !drawn, [tendons](RobotParameters& robot) {
                  std::vector<double*> all;
                  for (const std::size_t j : tendons) all.push_back(&Path(robot, j).presliding_m);
                  return all;
                });
    }
  }

  static TransmissionParameters& Path(RobotParameters& robot, std::size_t tendon) {
    return robot.actuation->tendons[tendon].transmission;
  }

  /// Those whose path the file draws, or the others.
  std::vector<std::size_t> Tendons(bool drawn) const {
    std::vector<std::size_t> which;
    for (std::size_t j = 0; j < robot_.actuation->tendons.size(); ++j)
      if (robot_.actuation->tendons[j].transmission.pulleys.empty() != drawn) which.push_back(j);
    return which;
  }

  static std::vector<double*> Frictions(TransmissionParameters& path) {
    std::vector<double*> all;
    for (PulleyParameters& pulley : path.pulleys) all.push_back(&pulley.alpha);
    return all;
  }

  /// One factor for several numbers of a robot with sheaths; the value is that of the first.
  void AddFactor(std::string key, const char* unit, const Uncertainty& known, bool assumed,
                 std::function<std::vector<double*>(RobotParameters&)> of) {
    const auto value = [of](RobotParameters robot) {
      RobotParameters its = WithSheaths(std::move(robot));
      return *of(its).front();
    };
    const auto deviation = DeviationOf(value(robot_), false, known);
    if (!deviation || value(robot_) == 0) return;
    all_.push_back({.key = std::move(key),
                    .unit = unit,
                    .deviation = *deviation,
                    .apply =
                        [of](PostureRobot& robot, double change) {
                          for (double* number : of(robot.robot)) *number *= std::exp(change);
                        },
                    .value = value,
                    .assumed = assumed});
  }

  void OfMount() {
    // Where the tracker's frame is unknown, so is the mount of the base.
    for (int axis = 0; axis < 3; ++axis) {
      Add(fmt::format("turn of gravity about {}", "xyz"[axis]), "rad", 1, known_ ? kTilt_rad : kAnyWay_rad,
          [axis](PostureRobot& robot, double change) {
            Eigen::Vector3d& g = robot.robot.body.gravity_W_mps2;
            g = Eigen::AngleAxisd(change, Eigen::Vector3d::Unit(axis)) * g;
          });
    }
    const double length_m = robot_.body.length_m();
    for (int axis = 0; axis < 3; ++axis) {
      Add(fmt::format("turn of the tracker about {}", "xyz"[axis]), "rad", 1,
          known_ ? kPlaced_rad : kGuessed_rad,
          [axis](PostureRobot& robot, double change) { robot.turn_rad[axis] += change; });
      Add(fmt::format("shift of the tracker along {}", "xyz"[axis]), "m", length_m,
          known_ ? kPlaced : kGuessed,
          [axis, length_m](PostureRobot& robot, double change) { robot.shift_m[axis] += length_m * change; });
    }
    for (const PosturePoint& point : points_) {
      for (int axis = 0; point.turn && axis < 3; ++axis) {
        Add(fmt::format("mount of the orientation sensor of disk {} about {}", point.disk + 1, "xyz"[axis]),
            "rad", 1, known_ ? kPlaced_rad : kGuessed_rad,
            [disk = point.disk, axis](PostureRobot& robot, double change) {
              robot.mount_rad.try_emplace(disk, Eigen::Vector3d::Zero()).first->second[axis] += change;
            });
      }
    }
    Add("lag behind the motors' readings", "s", 1, kLag_s,
        [](PostureRobot& robot, double change) { robot.motor_lag_s += change; });
    Add(kClockDrift, "s/s", kDrift, 1,
        [](PostureRobot& robot, double change) { robot.clock_drift += kDrift * change; });
  }

  const RobotParameters& robot_;
  const bool known_;
  const std::vector<PosturePoint>& points_;
  std::vector<PostureNumber> all_;
};

}  // namespace

RobotParameters WithSheaths(RobotParameters robot) {
  for (TendonDriveParameters& drive : robot.actuation->tendons) {
    if (!drive.transmission.pulleys.empty()) continue;
    drive.transmission.pulleys = {model::Sheath(kSheath_rad)};
    drive.transmission.presliding_m = kSheathPresliding_m;
  }
  return robot;
}

double PostureNumber::ValueAt(const RobotParameters& file, double change) const {
  const double in_file = value ? value(file) : 0;
  return additive ? in_file + per_change * change : in_file * std::exp(change);
}

double PostureNumber::ChangeTo(const RobotParameters& file, double its) const {
  const double in_file = value ? value(file) : 0;
  return additive ? (its - in_file) / per_change : std::log(its / in_file);
}

std::vector<PostureNumber> PostureNumbers(const RobotParameters& robot, bool frame_is_known,
                                          const std::vector<PosturePoint>& points) {
  return Listing(robot, frame_is_known, points).All();
}

PostureRobot WithNumbers(const PostureRobot& file, const std::vector<PostureNumber>& numbers,
                         const Eigen::VectorXd& changes) {
  PostureRobot robot = file;
  for (std::size_t k = 0; k < numbers.size(); ++k)
    numbers[k].apply(robot, changes[static_cast<Eigen::Index>(k)]);
  return robot;
}

}  // namespace tendril::gap
