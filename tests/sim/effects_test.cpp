// The whole registry against the nominal plant: nothing at nominal values, and at typical ones the documented
// link of the chain breaks, in the documented direction, on the tendon that was meant. A link is nominal when
// the nominal drivetrain, fed with the true signals on its near side, gives those on its far side.
#include "tendril/sim/effects.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <fstream>
#include <map>
#include <numbers>
#include <set>

#include "../../src/sim/drivetrain.h"
#include "../../src/sim/laws.h"
#include "motions.h"
#include "tendril/sim/plant.h"

namespace tendril::sim {
namespace {

using test::Rig;
using testing::HasSubstr;

// Noise of the rig's sensors, rms: what makes a change visible.
constexpr double kCell_N = 0.005;
constexpr double kTorque_Nm = 0.3e-3 * 7.056e-3;
const double kAngle_rad = 2 * std::numbers::pi / 2048 / std::sqrt(12.0);
constexpr double kTip_m = 5e-5;

constexpr double kStep_s = 5e-4;
constexpr int kSteps = 2100;

/// Torques that pull each tendon in turn to 6 N at the base, twice, and pay it out, ever faster, and then let
/// go of nothing for a while.
class Excitation {
 public:
  explicit Excitation(const RobotParameters& robot)
      : drives_(robot.actuation->tendons), capstan_(drives_[0].transmission, 20) {}

  Eigen::VectorXd At(double t) const {
    const int count = static_cast<int>(drives_.size());
    Eigen::VectorXd torque(count);
    const double start = std::min(1.0, 5 * t);
    for (int j = 0; j < count; ++j) {
      const double turns = 0.9 * t + 0.4 * t * t;
      const double phase = 2 * std::numbers::pi * (turns - static_cast<double>(j) / count);
      const double c = std::cos(phase), s = std::sin(phase);
      const double base_N = 0.3 + start * (0.5 + (c > 0 ? 5.2 * c * c : 0));
      const double z = start * std::tanh(20 * (c > 0 ? -s * c : -0.02 * s));
      const auto& d = drives_[static_cast<std::size_t>(j)];
      torque[j] = capstan_.BaseToMotor(base_N, z) * d.SpoolTravelPerMotorRad() * std::pow(0.84, -z) +
                  d.motor.coulomb_friction_Nm * z;
    }
    return torque;
  }

 private:
  std::vector<TendonDriveParameters> drives_;
  model::CapstanTable capstan_;
};

/// The chain's links of one tendon, near side to far side.
enum Link { kLoop, kMotor, kSpring, kPulleys, kEncoderLink, kCellLink, kLinks };
constexpr std::array<const char*, kLinks> kLinkNames{"target -> torque",   "torque -> tension",
                                                     "stretch -> tension", "motor side -> base",
                                                     "angle -> encoder",   "tension -> cell"};
const std::array<double, kLinks> kLinkNoise{kTorque_Nm, kCell_N, kCell_N, kCell_N, kAngle_rad, kCell_N};

/// What a residual is weighed with before its mean is taken, to compare its sign with the documented one.
enum class Weight { kOne, kMotion, kCommandRate };

/// One tendon's residuals: what is, less what the nominal law says of the signal before it.
struct Residual {
  double square = 0, mean = 0, with_motion = 0, with_command_rate = 0;
  int count = 0;
  void Add(double value, double motion, double command_rate) {
    square += value * value;
    mean += value;
    with_motion += value * (motion > 0 ? 1 : -1);
    with_command_rate += value * (command_rate > 0 ? 1 : -1);
    ++count;
  }
  double rms() const { return std::sqrt(square / count); }
  double Mean(Weight weight) const {
    const double sum = weight == Weight::kOne      ? mean
                       : weight == Weight::kMotion ? with_motion
                                                   : with_command_rate;
    return sum / count;
  }
};

struct Record {
  std::vector<std::array<Residual, kLinks>> link;  // by tendon
  Residual tracker;                                // |reported tip - tip|
  Eigen::MatrixXd state;                           // S x (q, angles, tensions of both sides), true
  Eigen::MatrixXd tip_m, reported_tip_m;           // S x 3

  double sigma(int tendon, int l) const {
    return link[static_cast<std::size_t>(tendon)][static_cast<std::size_t>(l)].rms() /
           kLinkNoise[static_cast<std::size_t>(l)];
  }
};

class Rigged {
 public:
  explicit Rigged(const RobotParameters& nominal)
      : nominal_(nominal),
        excitation_(nominal),
        capstan_(std::make_shared<model::CapstanTable>(nominal.actuation->tendons[0].transmission, 20)) {}

  Record Of(const std::vector<EffectSetting>& effects, int steps = kSteps) const {
    RobotParameters robot = nominal_;
    robot.effects = effects;
    Plant plant(robot, {.sensor_noise = false});
    const RobotParameters folded = FoldEffects(robot);
    const PlantLaws laws = PlantLaws::Of(folded);
    const int m = plant.tendons(), n = plant.body().dof();

    struct Sample {
      Eigen::VectorXd wanted;
      std::vector<TendonState> tendon;
      std::vector<TendonSensors> sensors;
    };
    std::vector<Sample> samples;
    Record run;
    run.state.resize(steps, n + 3 * m);
    run.tip_m.resize(steps, 3);
    run.reported_tip_m.resize(steps, 3);
    Eigen::VectorXd wanted = excitation_.At(0);
    for (int i = 0; i < steps; ++i) {
      plant.SetTorque(wanted);
      plant.Advance(kNsPerMs / 2);
      samples.push_back({wanted, plant.tendon(), plant.ReadSensors()});
      wanted = excitation_.At((i + 1) * kStep_s);
      run.state.row(i).head(n) = plant.q();
      for (int j = 0; j < m; ++j) {
        const auto& t = plant.tendon()[static_cast<std::size_t>(j)];
        run.state.row(i).segment<3>(n + 3 * j) << t.motor_angle_rad, t.tension_motor_N, t.tension_base_N;
      }
      run.tip_m.row(i) = plant.TipPose().p_WA.transpose();
      const TrackerReading reading = plant.ReadTracker();
      run.reported_tip_m.row(i) = reading.tip_W_m.transpose();
      run.tracker.Add((reading.tip_W_m - plant.TipPose().p_WA).norm(), 1, 1);
    }

    run.link.resize(static_cast<std::size_t>(m));
    for (std::size_t j = 0; j < run.link.size(); ++j) {
      const auto& p = nominal_.actuation->tendons[j];
      Drivetrain line(p, nominal_.limits.min_tension_N, capstan_);
      Drivetrain own(folded.actuation->tendons[j], nominal_.limits.min_tension_N, capstan_, laws.tendon[j]);
      for (int i = 1; i + 1 < steps; ++i) {
        const auto at = static_cast<std::size_t>(i);
        const TendonState &before = samples[at - 1].tendon[j], &now = samples[at].tendon[j],
                          &after = samples[at + 1].tendon[j];
        const TendonSensors& shown = samples[at].sensors[j];
        const double time = (i + 1) * kStep_s;
        const double shown_Nm = shown.torque_Nm;
        for (Drivetrain* d : {&line, &own}) {
          d->SetTorque(i * kStep_s, samples[at].wanted[static_cast<Eigen::Index>(j)]);
        }
        const double rate = (after.body_shortening_m - before.body_shortening_m) / (2 * kStep_s);
        const DrivetrainMotion motion{now.motor_angle_rad, now.motor_velocity_radps, now.body_shortening_m,
                                      rate};
        const double torque = line.Torque(time);
        const double reported = own.Torque(time);
        auto& link = run.link[j];
        const double w = now.motor_velocity_radps;
        const double command_rate = samples[at].wanted[static_cast<Eigen::Index>(j)] -
                                    samples[at - 1].wanted[static_cast<Eigen::Index>(j)];
        const auto add = [&](Link l, double value) { link[l].Add(value, w, command_rate); };
        add(kLoop, shown_Nm - torque);
        const double acceleration = own.Evaluate(time, motion).acceleration_radps2;
        add(kMotor, now.tension_motor_N - line.TensionFromTorque(time, motion, reported, acceleration));
        add(kSpring, now.tension_motor_N - line.TensionFromStretch(time, motion));
        add(kPulleys, now.tension_base_N - line.BaseTension(time, motion, now.tension_motor_N));
        add(kEncoderLink, shown.encoder_counts * 2 * std::numbers::pi / 2048 - now.motor_angle_rad);
        add(kCellLink, shown.load_cell_V / p.load_cell.gain_VpN - now.tension_motor_N);
        line.Commit(time, motion);
        own.Commit(time, motion);
      }
    }
    return run;
  }

 private:
  RobotParameters nominal_;
  Excitation excitation_;
  std::shared_ptr<const model::CapstanTable> capstan_;
};

/// Largest change over all samples and states, in noise of a sensor for each.
double Change(const Record& a, const Record& b, int bending) {
  double worst = 0;
  for (int c = 0; c < a.state.cols(); ++c) {
    const double noise = c < bending ? kTip_m / 0.045 : (c - bending) % 3 == 0 ? kAngle_rad : kCell_N;
    worst = std::max(worst, (a.state.col(c) - b.state.col(c)).cwiseAbs().maxCoeff() / noise);
  }
  return worst;
}
double Rms(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  return std::sqrt((a - b).squaredNorm() / static_cast<double>(a.rows()));
}

class EffectsTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    robot = new RobotParameters(Rig());
    rigged = new Rigged(*robot);
    nominal = new Record(rigged->Of({}));
  }
  static void TearDownTestSuite() {
    delete nominal;
    delete rigged;
    delete robot;
  }

  /// The effect at nominal values, one primary parameter at nominal + typical.
  static EffectSetting Typical(const Effect& effect, const std::string& where, std::string_view parameter) {
    EffectSetting setting{std::string(effect.name), where, {}};
    for (const EffectParameter& p : effect.parameters) {
      setting.values.emplace_back(p.name, p.nominal + (p.name == parameter ? p.typical : 0));
    }
    return setting;
  }
  static std::string Everywhere(const Effect& effect) {
    return TargetText(effect, effect.on_all ? Target{} : Target{1});
  }

  static RobotParameters* robot;
  static Rigged* rigged;
  static Record* nominal;
};
RobotParameters* EffectsTest::robot = nullptr;
Rigged* EffectsTest::rigged = nullptr;
Record* EffectsTest::nominal = nullptr;

TEST_F(EffectsTest, TheNominalPlantIsItsLinks) {
  for (int j = 0; j < 3; ++j) {
    for (int l = 0; l < kLinks; ++l) {
      SCOPED_TRACE(kLinkNames[static_cast<std::size_t>(l)]);
      // What the link itself rounds is its noise; the others are exact but for the sampling.
      EXPECT_LT(nominal->sigma(j, l), l == kLoop || l == kEncoderLink ? 1.1 : 0.5);
    }
  }
}

TEST_F(EffectsTest, NominalValuesAreTheNominalPlant) {
  constexpr int kShort = kSteps / 3;
  const Record expected = rigged->Of({}, kShort);
  for (const Effect& effect : Effects()) {
    SCOPED_TRACE(effect.name);
    const Record run = rigged->Of({Typical(effect, Everywhere(effect), "")}, kShort);
    EXPECT_LT(Change(run, expected, 8), 1e-6);
    for (int j = 0; j < 3; ++j) {
      for (int l = 0; l < kLinks; ++l) EXPECT_NEAR(run.sigma(j, l), expected.sigma(j, l), 1e-6);
    }
    EXPECT_LT(Rms(run.reported_tip_m, expected.reported_tip_m), 1e-6 * kTip_m);
  }
}

/// The link that an effect is documented to break; none for the body and for the tracker.
std::optional<Link> LinkOf(const Effect& effect) {
  switch (effect.cut) {
    case Cut::kCurrentLoop:
      return kLoop;
    case Cut::kDrivetrain:
      return kMotor;
    case Cut::kTendon:
      return effect.stage == Stage::kSensor ? kEncoderLink : kSpring;
    case Cut::kShape:
      if (effect.stage == Stage::kTransmission) return kPulleys;
      break;
    case Cut::kSensors:
      if (effect.scope == Scope::kTendon) return kCellLink;
      break;
    default:
      break;
  }
  return std::nullopt;
}

// Which way a link is off, far side less what the near side explains: over all samples, with the sign of the
// motor's motion (the same as: pulling less paying out), or with the sign of the command's change.
struct Direction {
  std::string_view effect;
  Weight weight;
  int sign;
};
constexpr Direction kDirections[] = {
    {"torque_constant", Weight::kOne, +1},
    {"gear_efficiency", Weight::kMotion, +1},
    {"motor_coulomb", Weight::kMotion, -1},
    {"motor_viscous", Weight::kMotion, -1},
    {"stribeck", Weight::kMotion, -1},
    {"torque_loop_lag", Weight::kCommandRate, -1},
    {"command_delay", Weight::kCommandRate, -1},
    {"torque_saturation", Weight::kOne, -1},
    {"capstan_alpha", Weight::kMotion, -1},
    {"wrap_angle", Weight::kMotion, -1},
    {"pulley_coulomb", Weight::kMotion, -1},
    {"tendon_stiffness", Weight::kOne, +1},
    {"tendon_creep", Weight::kOne, -1},
    {"backlash", Weight::kMotion, -1},
    {"slack", Weight::kOne, -1},
    {"spool_growth", Weight::kOne, +1},
    {"cell_offset", Weight::kOne, +1},
    {"cell_gain", Weight::kOne, +1},
    {"cell_drift", Weight::kOne, +1},
    {"encoder_offset", Weight::kOne, +1},
};

TEST_F(EffectsTest, TypicalValuesBreakTheDocumentedLinkInTheDocumentedDirection) {
  for (const Effect& effect : Effects()) {
    for (const EffectParameter& parameter : effect.parameters) {
      if (parameter.shape) continue;
      SCOPED_TRACE(std::string(effect.name) + "." + std::string(parameter.name));
      const Record run = rigged->Of({Typical(effect, Everywhere(effect), parameter.name)});

      // The truth is moved by all but sensors; the reported torque, here commanded openly, by the drive only.
      const double truth = Rms(run.tip_m, nominal->tip_m) / kTip_m + Change(run, *nominal, 8);
      if (effect.stage == Stage::kSensor) {
        EXPECT_EQ(truth, 0);
      } else {
        EXPECT_GT(truth, 3);
      }
      const std::optional<Link> broken = LinkOf(effect);
      for (int j = 0; j < 3; ++j) {
        if (broken) {
          EXPECT_GT(run.sigma(j, *broken), 2) << "tendon " << j + 1;
        }
        for (int l = 0; l < kLinks; ++l) {
          if (l == broken) continue;
          SCOPED_TRACE(kLinkNames[static_cast<std::size_t>(l)]);
          // Others stay whole, or are hurt far less (the arm of a growing spool, the slide behind a play).
          const double share = broken ? 0.25 * run.sigma(j, *broken) : 0;
          EXPECT_LT(run.sigma(j, l), std::max(1.2, share)) << "tendon " << j + 1;
          if (l == kLoop) {
            EXPECT_NEAR(run.sigma(j, l), nominal->sigma(j, l), 1e-9);
          }
        }
        for (const Direction& d : kDirections) {
          if (d.effect != effect.name) continue;
          const Residual& r = run.link[static_cast<std::size_t>(j)][static_cast<std::size_t>(*broken)];
          EXPECT_GT(d.sign * r.Mean(d.weight), 0.1 * r.rms()) << "tendon " << j + 1;
        }
      }
      if (effect.stage == Stage::kBody) {
        EXPECT_TRUE(effect.cut == Cut::kShape || effect.cut == Cut::kMotion);
        EXPECT_GT(Rms(run.tip_m, nominal->tip_m), 3 * kTip_m);
      }
      if (effect.stage == Stage::kSensor && effect.scope == Scope::kRobot) {
        EXPECT_GT(run.tracker.rms(), 3 * kTip_m);
      } else {
        EXPECT_EQ(run.tracker.rms(), 0);
      }
    }
  }
}

// One setting of all motors, each with its phase, is as many settings of one motor.
TEST_F(EffectsTest, EveryMotorMayHaveAPhaseOfItsOwn) {
  const auto set = [](const char* text) { return ParseEffect(text, *robot); };
  const Record all =
      rigged->Of({set("cogging amplitude_Nm=1e-4 phase_rad=0.5 phase_2_rad=1 phase_3_rad=-2")});
  const Record each = rigged->Of({set("cogging where=tendon:1 amplitude_Nm=1e-4 phase_rad=0.5"),
                                  set("cogging where=tendon:2 amplitude_Nm=1e-4 phase_rad=1.5"),
                                  set("cogging where=tendon:3 amplitude_Nm=1e-4 phase_rad=-1.5")});
  EXPECT_EQ(all.state, each.state);
  RobotParameters with = *robot;
  with.effects = {set("cogging amplitude_Nm=1e-4 phase_3_rad=-2")};
  EXPECT_EQ(config::ParseRobot(config::ToYaml(with), "again").effects, with.effects);
  const Record alike = rigged->Of({set("cogging amplitude_Nm=1e-4 phase_rad=0.5")});
  EXPECT_NE(all.state, alike.state);
  try {
    set("cogging where=tendon:2 amplitude_Nm=1e-4 phase_2_rad=1");
    FAIL() << "accepted";
  } catch (const std::invalid_argument& e) {
    EXPECT_THAT(e.what(), testing::HasSubstr("cogging has no parameter 'phase_2_rad'"));
  }
}

TEST_F(EffectsTest, OneTendonAloneIsMeantAlone) {
  for (const Effect& effect : Effects()) {
    const std::optional<Link> broken = LinkOf(effect);
    if (effect.scope != Scope::kTendon || !effect.on_one || !broken) continue;
    SCOPED_TRACE(effect.name);
    const Record run = rigged->Of({Typical(effect, "tendon:2", effect.parameters[0].name)});
    EXPECT_GT(run.sigma(1, *broken), 2);
    EXPECT_LT(run.sigma(0, *broken), 1.2);
    EXPECT_LT(run.sigma(2, *broken), 1.2);
  }
}

TEST_F(EffectsTest, TheTrackerReportsTheTipTurnedAndShifted) {
  const Record run =
      rigged->Of({{"tracker_rotation", "all", {{"x_rad", 0.1}, {"y_rad", -0.2}, {"z_rad", 0.3}}},
                  {"tracker_offset", "all", {{"x_m", 0.001}, {"z_m", -0.002}}}});
  const Eigen::Vector3d turn(0.1, -0.2, 0.3);
  const Eigen::Matrix3d r = Eigen::AngleAxisd(turn.norm(), turn.normalized()).toRotationMatrix();
  const Eigen::MatrixXd expected =
      (run.tip_m * r.transpose()).rowwise() + Eigen::RowVector3d(0.001, 0, -0.002);
  EXPECT_LT((run.reported_tip_m - expected).cwiseAbs().maxCoeff(), 1e-15);
}

TEST_F(EffectsTest, TheCellReportsGainTimesTensionPlusOffsetPlusDrift) {
  RobotParameters real = *robot;
  real.effects = {{"cell_gain", "all", {{"scale", 1.1}}},
                  {"cell_offset", "all", {{"N", -0.2}}},
                  {"cell_drift", "tendon:3", {{"N_per_s", 0.05}}}};
  Plant plant(real, {.sensor_noise = false});
  for (int i = 0; i < 1000; ++i) plant.Advance(kNsPerMs);
  for (std::size_t j = 0; j < 3; ++j) {
    const auto& cell = robot->actuation->tendons[j].load_cell;
    const double reading = plant.ReadSensors()[j].load_cell_V / cell.gain_VpN;
    const double drift = j == 2 ? 1.1 * 0.05 : 0;  // of the bridge, before the amplifier
    EXPECT_NEAR(reading, 1.1 * plant.tendon()[j].tension_motor_N - 0.2 + drift,
                0.51 * cell.resolution_V / cell.gain_VpN);
  }
}

// Effects that are numbers of the file do there what they do in the list.
TEST_F(EffectsTest, FoldingChangesNothing) {
  RobotParameters listed = *robot;
  for (const Effect& effect : Effects()) {
    for (const EffectParameter& p : effect.parameters) {
      if (p.shape) continue;
      listed.effects.push_back(Typical(effect, Everywhere(effect), p.name));
      break;
    }
  }
  const RobotParameters folded = FoldEffects(listed);
  for (const EffectSetting& law : folded.effects) EXPECT_TRUE(FindEffect(law.name)->add) << law.name;
  EXPECT_LT(folded.effects.size(), listed.effects.size());
  Plant a(listed), b(folded);
  const Excitation excitation(*robot);
  for (int i = 0; i < 100; ++i) {
    const Eigen::VectorXd torque = excitation.At(1e-3 * i);
    for (Plant* plant : {&a, &b}) {
      plant->SetTorque(torque);
      plant->Advance(kNsPerMs);
    }
  }
  EXPECT_EQ((a.q() - b.q()).cwiseAbs().maxCoeff(), 0);
}

// The order of the list does not matter.
TEST_F(EffectsTest, OrderOfTheListDoesNotMatter) {
  std::vector<EffectSetting> effects{{"cell_gain", "all", {{"scale", 1.2}}},
                                     {"cell_offset", "tendon:1", {{"N", 0.1}}},
                                     {"capstan_n", "all", {{"scale", 1.1}}},
                                     {"capstan_n", "tendon:2", {{"scale", 0.9}}},
                                     {"backlash", "all", {{"rad", 0.05}}}};
  RobotParameters one = *robot, other = *robot;
  one.effects = effects;
  std::reverse(effects.begin(), effects.end());
  other.effects = effects;
  EXPECT_EQ(config::ToYaml(FoldEffects(one)), config::ToYaml(FoldEffects(other)));
}

// A fit may try anything within the bounds, whatever the motion.
TEST_F(EffectsTest, AnyValueWithinTheBoundsCanBeSimulated) {
  for (const Effect& effect : Effects()) {
    for (const EffectParameter& parameter : effect.parameters) {
      for (const double value : {parameter.lower, parameter.upper}) {
        SCOPED_TRACE(testing::Message() << effect.name << '.' << parameter.name << " = " << value);
        EffectSetting setting =
            Typical(effect, Everywhere(effect), parameter.shape ? effect.parameters[0].name : "");
        for (auto& [name, v] : setting.values) v = name == parameter.name ? value : v;
        RobotParameters real = *robot;
        real.effects = {setting};
        Plant plant(real);
        for (int i = 0; i < 80; ++i) {
          const int pulled = i / 10 % 4;  // 3: none, all are pushed off
          Eigen::Vector3d torque = Eigen::Vector3d::Constant(pulled == 3 ? -1e-3 : 1e-4);
          if (pulled < 3) torque[pulled] = 4e-3;
          plant.SetTorque(torque);
          ASSERT_NO_THROW(plant.Advance(kNsPerMs));
        }
        EXPECT_TRUE(plant.q().allFinite());
        EXPECT_LT(plant.q().cwiseAbs().maxCoeff(), 2);
      }
    }
  }
}

// With laws that have corners and memories, along the paper's slow circle: what half the tolerance would
// change. Faster, or where a motor sticks and slips, dry friction magnifies any change, a tolerance's too.
TEST_F(EffectsTest, TheSolverIsFinerThanTheSensors) {
  RobotParameters real = *robot;
  real.effects = {{"cogging", "tendon:1", {{"amplitude_Nm", 1e-4}, {"periods_per_turn", 14}}},
                  {"command_delay", "all", {{"s", 0.0023}}},
                  {"tendon_creep", "all", {{"fraction", 0.2}, {"tau_s", 1}}},
                  {"backlash", "tendon:2", {{"rad", 0.1}}},
                  {"backbone_hysteresis", "all", {{"moment_Nm", 1e-3}}}};
  const test::CircleTorque circle(*robot);
  const auto run = [&](double factor) {
    PlantOptions options;
    options.relative_tolerance *= factor;
    options.absolute_tolerance *= factor;
    Plant plant(real, options);
    std::array<Eigen::MatrixXd, 4> channels;  // motor angles, tensions on both sides, tip
    for (auto& channel : channels) channel.resize(3000, 3);
    for (int i = 0; i < 3000; ++i) {
      plant.SetTorque(circle.At(ToSeconds(plant.time_ns())));
      plant.Advance(kNsPerMs);
      for (int j = 0; j < 3; ++j) {
        const TendonState& t = plant.tendon()[static_cast<std::size_t>(j)];
        channels[0](i, j) = t.motor_angle_rad / kAngle_rad;
        channels[1](i, j) = t.tension_motor_N / kCell_N;
        channels[2](i, j) = t.tension_base_N / kCell_N;
      }
      channels[3].row(i) = plant.TipPose().p_WA.transpose() / kTip_m;
    }
    return channels;
  };
  const auto usual = run(1), half = run(0.5);
  std::array<double, 4> change;
  for (std::size_t c = 0; c < 4; ++c) change[c] = Rms(usual[c], half[c]) / std::sqrt(3.0);
  std::printf(
      "half the tolerance, in noise: encoder %.4f, cell before %.4f and behind the pulleys %.4f, tip %.4f\n",
      change[0], change[1], change[2], change[3]);
  EXPECT_LT(change[0], 0.1);
  for (std::size_t c = 1; c < 4; ++c) EXPECT_LT(change[c], 0.05);
}

// ---- the registry itself ----

TEST(EffectRegistry, HasEveryNameThatAReportMayUse) {
  for (const char* name : {"torque_constant",
                           "gear_efficiency",
                           "motor_coulomb",
                           "motor_viscous",
                           "stribeck",
                           "cogging",
                           "torque_loop_lag",
                           "command_delay",
                           "torque_saturation",
                           "capstan_alpha",
                           "capstan_n",
                           "wrap_angle",
                           "presliding",
                           "pulley_coulomb",
                           "tendon_stiffness",
                           "tendon_creep",
                           "backlash",
                           "slack",
                           "spool_growth",
                           "bending_stiffness",
                           "unit_stiffness",
                           "precurvature",
                           "backbone_hysteresis",
                           "superelastic",
                           "bending_damping",
                           "routing_friction",
                           "hole_radius",
                           "hole_angle",
                           "unit_length",
                           "unit_mass",
                           "tip_payload",
                           "tip_force",
                           "base_tilt",
                           "contact",
                           "torsion",
                           "torsional_stiffness",
                           "axial_stiffness",
                           "cell_gain",
                           "cell_offset",
                           "cell_drift",
                           "encoder_offset",
                           "tracker_rotation",
                           "tracker_offset",
                           "tracker_delay"}) {
    EXPECT_NE(FindEffect(name), nullptr) << name;
  }
}

TEST(EffectRegistry, EntriesAreCompleteAndConsistent) {
  std::set<std::string_view> names;
  int stage = 0;
  for (const Effect& effect : Effects()) {
    SCOPED_TRACE(effect.name);
    EXPECT_TRUE(names.insert(effect.name).second);
    EXPECT_EQ(FindEffect(effect.name), &effect);
    EXPECT_NE(effect.edit == nullptr, effect.add == nullptr);
    EXPECT_TRUE(effect.on_all || effect.on_one);
    EXPECT_TRUE(effect.scope != Scope::kRobot || (effect.on_all && !effect.on_one));
    EXPECT_GE(static_cast<int>(effect.stage), stage) << "not in chain order";
    stage = static_cast<int>(effect.stage);

    std::set<std::string_view> parameters;
    bool primary = false;
    for (const EffectParameter& p : effect.parameters) {
      SCOPED_TRACE(p.name);
      EXPECT_TRUE(parameters.insert(p.name).second);
      EXPECT_LE(p.lower, p.nominal);
      EXPECT_GE(p.upper, p.nominal);
      for (const double start : p.starts) EXPECT_TRUE(start >= p.lower && start <= p.upper) << start;
      if (p.shape) {
        EXPECT_FALSE(p.starts.empty());
        continue;
      }
      primary = true;
      EXPECT_EQ(p.nominal, p.name == "scale" ? 1 : 0);
      EXPECT_NE(p.typical, 0);
      EXPECT_TRUE(p.nominal + p.typical >= p.lower && p.nominal + p.typical <= p.upper);
    }
    EXPECT_TRUE(primary);

    EXPECT_TRUE(effect.summary.size() > 20 && effect.summary.size() < 100 && !effect.summary.ends_with('.'));
    for (const std::string_view text : {effect.physics, effect.signature, effect.experiment}) {
      EXPECT_GT(text.size(), 40u);
      EXPECT_TRUE(text.ends_with('.')) << text;
      EXPECT_EQ(text.find("  "), text.npos) << text;
    }
    EXPECT_FALSE(effect.confusable.empty());
    for (const std::string_view other : effect.confusable) {
      EXPECT_NE(FindEffect(other), nullptr) << other;
      EXPECT_NE(other, effect.name);
    }
  }
}

TEST(EffectRegistry, TextSettingAndFileAreOne) {
  RobotParameters robot = Rig();
  for (const Effect& effect : Effects()) {
    SCOPED_TRACE(effect.name);
    const Target target = effect.on_one ? Target{0} : Target{};
    std::string text = std::string(effect.name) + " where=" + TargetText(effect, target);
    std::vector<double> values;
    for (const EffectParameter& p : effect.parameters) {
      values.push_back(p.nominal + p.typical / 3);
      char number[40];
      std::snprintf(number, sizeof number, "%.17g", values.back());
      text.append(" ").append(p.name).append("=").append(number);
    }
    const EffectSetting setting = ParseEffect(text, robot);
    EXPECT_EQ(ValuesOf(setting, robot), values);
    EXPECT_EQ(ParseTarget(effect, setting.where, robot), target);
    robot.effects.push_back(setting);
  }
  EXPECT_EQ(config::ParseRobot(config::ToYaml(robot), "again").effects, robot.effects);
  EXPECT_NO_THROW(CheckEffects(robot));
}

TEST(EffectRegistry, WrapOnAPathDrawnWithoutPulleysIsASheath) {
  RobotParameters robot = Rig();
  robot.actuation->tendons[1].transmission.pulleys.clear();
  robot.effects = {ParseEffect("wrap_angle where=tendon:2 extra_rad=2", robot)};
  const RobotParameters folded = FoldEffects(robot);
  const std::vector<PulleyParameters>& path = folded.actuation->tendons[1].transmission.pulleys;
  ASSERT_EQ(path.size(), 1u);
  EXPECT_EQ(path[0].wrap_rad, 2);
  EXPECT_GT(path[0].alpha, 0);
  robot.effects = {ParseEffect("wrap_angle where=tendon:2 extra_rad=-1", robot)};
  EXPECT_TRUE(FoldEffects(robot).actuation->tendons[1].transmission.pulleys.empty());
}

TEST(EffectRegistry, AValueOutOfBoundsIsRefused) {
  RobotParameters robot = Rig();
  for (const Effect& effect : Effects()) {
    const std::string where = TargetText(effect, effect.on_all ? Target{} : Target{0});
    for (const EffectParameter& p : effect.parameters) {
      for (const double value : {p.lower - 1e-6, p.upper + 1e-6, double{NAN}, double{INFINITY}}) {
        EffectSetting setting{std::string(effect.name), where, {{std::string(p.name), value}}};
        robot.effects = {setting};
        const std::string full = std::string(effect.name) + "." + std::string(p.name);
        EXPECT_THAT([&] { CheckEffects(robot); }, testing::ThrowsMessage<EffectError>(testing::AllOf(
                                                      HasSubstr(full), HasSubstr("accepted"))));
      }
    }
  }
}

TEST(EffectRegistry, NonsenseIsRefusedInOneLine) {
  const RobotParameters robot = Rig();
  const std::pair<const char*, const char*> cases[] = {
      {"", "without a name"},
      {"backlsh rad=0.1", "no effect 'backlsh'"},
      {"backlash", "backlash without rad"},
      {"backlash rad", "'rad' is not key=value"},
      {"backlash rad=much", "backlash.rad = 'much'"},
      {"backlash rad=0.1x", "backlash.rad = '0.1x'"},
      {"backlash rad=0.1 rad=0.2", "backlash.rad twice"},
      {"backlash mm=0.1", "backlash has no parameter 'mm'"},
      {"backlash rad=0.1 where=tendon:0", "tendon:1 .. tendon:3"},
      {"backlash rad=0.1 where=tendon:4", "tendon:1 .. tendon:3"},
      {"backlash rad=0.1 where=tendon:1x", "tendon:1 .. tendon:3"},
      {"backlash rad=0.1 where=unit:1", "accepted: all, tendon:1"},
      {"tracker_delay s=0.01 where=tendon:1", "accepted: all;"},
      {"stribeck speed_radps=1", "stribeck without torque_Nm"},
  };
  for (const auto& [text, says] : cases) {
    SCOPED_TRACE(text);
    const auto parse = [text = text, &robot] { ParseEffect(text, robot); };
    EXPECT_THAT(parse, testing::ThrowsMessage<std::invalid_argument>(testing::AllOf(
                           HasSubstr(says), HasSubstr("accepted: "), testing::Not(HasSubstr("\n")))));
  }
  RobotParameters twice = robot;
  twice.effects = {ParseEffect("slack m=1e-4", robot), ParseEffect("slack m=1e-3", robot)};
  EXPECT_THAT([&] { Plant plant(twice); },
              testing::ThrowsMessage<EffectError>(testing::StartsWith("effects[2]: slack on all twice")));
  const RobotParameters bare = Rig("qi2021_90mm");
  EXPECT_THROW(ParseEffect("backlash rad=0.1", bare), std::invalid_argument);
  EXPECT_NO_THROW(ParseEffect("tip_payload mass_kg=0.001", bare));
}

TEST(EffectRegistry, ABadEntryOfAFileIsNamedByItsLine) {
  const std::string path = testing::TempDir() + "effects_test_robot.yaml";
  std::ifstream shipped(TENDRIL_SOURCE_DIR "/config/robots/rig_90mm.yaml");
  const std::string rig{std::istreambuf_iterator<char>(shipped), {}};
  std::ofstream(path)
      << "effects:\n  - {effect: slack, m: 1.0e-4}\n  - effect: backlash\n    where: tendon:5\n"
         "    rad: 0.05\n"
      << rig;
  const auto load = [&] { LoadRobot(path); };
  EXPECT_THAT(load, testing::ThrowsMessage<config::ConfigError>(testing::AllOf(
                        testing::StartsWith(path + ":3: effects[2]: "),
                        HasSubstr("where = 'tendon:5'; accepted: all, tendon:1 .. tendon:3"))));
  std::remove(path.c_str());
}

}  // namespace
}  // namespace tendril::sim
