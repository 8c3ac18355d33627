// The effects a real robot has and the nominal model has not, or has with a wrong number: their registry, and
// how a robot gets them. One file of src/sim/effects and one line of the registry each. Knows nothing of logs
// or fits.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/sim/yardstick.h"

namespace tendril::sim {

class PlantLaws;

/// Part of the chain from command to tip that an effect belongs to.
enum class Stage { kDrive, kTransmission, kBody, kSensor };
/// "drive", "transmission", "body", "sensors".
std::string_view StageName(Stage stage);

/// A place in the chain where signals are measured on both sides, in chain order (C0..C6).
enum class Cut {
  kClock,        // C0 timestamps
  kCurrentLoop,  // C1 target torque -> actual torque
  kDrivetrain,   // C2 actual torque and encoder -> load cell
  kTendon,       // C3 encoder and shape -> tension
  kShape,        // C4 load cell -> quasi-static shape
  kMotion,       // C5 load cell -> motion in time
  kSensors,      // C6 redundant sensors
};
inline constexpr int kCuts = 7;
/// "C0".."C6".
std::string_view CutName(Cut cut);

/// What one setting of an effect may be about.
enum class Scope { kRobot, kTendon, kUnit, kSection };
/// "robot", "tendon", "unit", "section".
std::string_view ScopeName(Scope scope);

/// The one element of the transmission that an effect is about; kAny: none, or several.
enum class Element { kAny, kTendon, kPulleys };

/// Of the registry (Effect::parameters): with the values of the reference rig, from which those of a robot
/// follow by the yardstick; of ParametersOf: with the robot's own.
struct EffectParameter {
  std::string name;             // "scale", "mass_kg": SI, the unit at its end
  double nominal = 0;           // value without the effect: 1 for a scale, else 0
  double lower = 0, upper = 0;  // physical bounds
  double typical = 0;           // a plainly visible deviation from nominal: scale of steps and starts
  /// A shape parameter (a time constant, a yield) means nothing while the effect's others are nominal; then
  /// `nominal` is its usual value and `starts` are where a search begins. Of a size, `starts` are values,
  /// nearer or farther than `typical`, at which the robot answers otherwise: a soft wall yields, a hard one
  /// stops.
  bool shape = false;
  std::vector<double> starts{};
  /// Where one effect is on all tendons (units), and each has this number as it happens, as motors their
  /// phase: the name of what number {} from the second on has beyond the first, "phase_{}_rad".
  std::string each{};
  Yardstick of = Yardstick::kNone;  // what the values above are in proportion to
};

/// Which tendon, unit or section, counted from 0; all of them when empty.
using Target = std::optional<int>;

struct Effect {
  std::string_view name;
  Stage stage{};
  Scope scope{};
  Cut cut{};             // where it shows first, with a load cell on the motor's side
  Cut cut_robot_side{};  // the same with the cell between pulleys and robot
  bool on_all = true;    // one value for all tendons (units) is a hypothesis
  bool on_one = false;   // one tendon (unit) alone is one
  /// Constant that nobody can know beforehand (a pre-sliding length): free within its bounds, not accused
  /// alone while its change is immaterial.
  bool nuisance = false;
  Element element = Element::kAny;
  bool zero = false;   // the same as another zero of the motor's position
  bool frame = false;  // the same as another frame of the tracker
  /// The key of the robot file whose number `edit` changes, without the numbers of sections and tendons;
  /// empty: none, or not by itself.
  std::string_view number{};
  std::vector<EffectParameter> parameters;
  // For people, a few sentences each (`tendril gap explain`).
  std::string_view summary;                  // one line
  std::string_view physics;                  // what happens, with the law in words and symbols
  std::string_view signature;                // how it looks in the data
  std::string_view experiment;               // what shows it
  std::vector<std::string_view> confusable;  // effects that look alike, by name
  /// Exactly one of the two. `edit`: the effect is a number that the robot file has, so the controller can
  /// know it too. `add`: a law that only the simulator has.
  void (*edit)(RobotParameters& robot, Target target, std::span<const double> values) = nullptr;
  void (*add)(PlantLaws& laws, const RobotParameters& robot, Target target,
              std::span<const double> values) = nullptr;
};

/// All effects, in chain order; the order and the addresses stay.
std::span<const Effect> Effects();
/// nullptr when there is none of this name.
const Effect* FindEffect(std::string_view name);
/// The effect that changes the number at this key of the robot file (Effect::number); nullptr: none.
const Effect* FindEffectOfNumber(std::string_view key);
/// The effect's parameters at a place of this robot: effect.parameters with bounds, typical deviations,
/// starts and usual shapes of its size (three digits, for a yardstick is no measurement), and behind them,
/// where it is on all, those that each tendon (unit) has of its own.
std::vector<EffectParameter> ParametersOf(const Effect& effect, Target target, const RobotParameters& robot);

/// What is wrong with one of robot.effects.
class EffectError : public std::invalid_argument {
 public:
  EffectError(int entry, const std::string& text);  // what(): "effects[2]: " and the text
  int entry() const { return entry_; }              // from 1
  const std::string& text() const { return text_; }

 private:
  int entry_;
  std::string text_;
};

/// "all", "tendon:2", "unit:1", "section:1" <-> target of an effect on this robot. Throws
/// std::invalid_argument with the accepted ones.
Target ParseTarget(const Effect& effect, std::string_view where, const RobotParameters& robot);
std::string TargetText(const Effect& effect, Target target);
/// Every `where` that the effect may have on any robot: "all or tendon:NUMBER".
std::string WhereText(const Effect& effect);

/// "backlash where=tendon:2 rad=0.05" (the form of command lines) -> a setting, checked against the registry
/// and the robot: unknown names, values out of bounds and missing primary parameters throw
/// std::invalid_argument with what, accepted and remedy.
EffectSetting ParseEffect(std::string_view text, const RobotParameters& robot);
/// Throws EffectError for the first of robot.effects that is not as ParseEffect wants it, or there twice.
void CheckEffects(const RobotParameters& robot);
/// config::LoadRobot with CheckEffects; config::ConfigError names the line of the entry that is wrong.
RobotParameters LoadRobot(const std::string& path);
/// All of an effect's parameters in the order of ParametersOf: those the setting names, the others nominal.
std::vector<double> ValuesOf(const EffectSetting& setting, const RobotParameters& robot);

/// Where in robot.effects a law is set for this target, if it is; an effect that is a parameter is no law.
std::optional<std::size_t> FindLaw(const RobotParameters& robot, const Effect& effect, Target target);
/// The same of a setting's effect and target.
std::optional<std::size_t> FindLaw(const RobotParameters& robot, const EffectSetting& setting);
/// The robot with a law more, or otherwise where it has that law at that place already.
void SetLaw(RobotParameters& robot, const EffectSetting& setting);

/// The robot with every effect that is a parameter worked into its numbers; `effects` keeps only laws. Bounds
/// are not checked again: they were those of the robot before.
RobotParameters FoldEffects(const RobotParameters& robot);

/// Where the robot's effects place its tracker: of a point p it reports R p + offset_m.
struct TrackerPlacement {
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  Eigen::Vector3d offset_m = Eigen::Vector3d::Zero();
};
TrackerPlacement PlacementOfTracker(const RobotParameters& robot);

}  // namespace tendril::sim
