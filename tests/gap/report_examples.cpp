// Invented but plausible: a robot of one section and four tendons whose runs were compared with its
// simulation. Knows nothing of the report.
#include "report_examples.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>
#include <random>

namespace tendril::gap {
namespace {

using sim::Cut;

constexpr double kPi = std::numbers::pi;
constexpr int kTendons = 4;

struct Maker {
  Diagnosis d;
  std::mt19937_64 random{7};
  std::normal_distribution<double> normal;

  double Noise(double size) { return size * normal(random); }

  void Find(Cut cut, const std::string& where, const char* quantity, const char* unit, double floor,
            double sigma, double delta, bool first = false, bool measured = true, const char* note = "") {
    CutFinding f;
    f.cut = cut;
    f.where = where;
    f.quantity = quantity;
    f.unit = unit;
    f.measured = measured;
    f.floor = floor;
    f.excess_sigma = sigma;
    f.rms = floor * std::sqrt(1 + sigma * sigma);
    f.delta = delta;
    f.excess = measured && sigma * floor > delta;
    f.p_value = f.excess ? 0.0005 : 0.3 + 0.1 * sigma;
    f.first = first;
    f.note = note;
    d.location.push_back(f);
  }

  void Chain(Cut first, double sigma, bool tracker = true, double later = 1) {
    const auto at = [&](Cut cut, double quiet, double after) {
      return (cut == first               ? sigma
              : cut > first && sigma > 0 ? later * after
                                         : quiet) *
             (1 + 0.15 * std::abs(normal(random)));
    };
    Find(Cut::kClock, "all", "timestamps", "s", 4e-5, 0.1, 1e-3);
    for (int j = 1; j <= kTendons; ++j) {
      Find(Cut::kCurrentLoop, fmt::format("tendon:{}", j), "torque", "N·m", 4e-4,
           at(Cut::kCurrentLoop, 0.2, 0.2), 1e-3);
    }
    for (int j = 1; j <= kTendons; ++j) {
      const bool here = first == Cut::kDrivetrain && (j == 2 || j == 3);
      Find(Cut::kDrivetrain, fmt::format("tendon:{}", j), "tension", "N", 0.031,
           here ? sigma * (j == 2 ? 1 : 0.6) : 0.3, 0.06, here);
    }
    for (int j = 1; j <= kTendons; ++j) {
      Find(Cut::kTendon, fmt::format("tendon:{}", j), "tension", "N", 0.045, at(Cut::kTendon, 0.4, 0.4), 0.06,
           first == Cut::kTendon);
    }
    const char* no_tracker = "No tracker: the shape cannot be compared.";
    Find(Cut::kShape, "section:1", "tip position", "m", 3.2e-4, at(Cut::kShape, 0.4, 3), 5e-4,
         first == Cut::kShape, tracker, tracker ? "" : no_tracker);
    Find(Cut::kShape, "section:1", "tip direction", "rad", 6e-3, at(Cut::kShape, 0.4, 2.4), 8e-3,
         first == Cut::kShape, tracker, tracker ? "" : no_tracker);
    Find(Cut::kMotion, "section:1", "tip position", "m", 4e-4, at(Cut::kMotion, 0.4, 2.2), 5e-4,
         first == Cut::kMotion, tracker, tracker ? "" : no_tracker);
    if (tracker) Find(Cut::kSensors, "all", "tracker against cells", "m", 5e-4, 0.2, 5e-4);
  }

  Cause& Suspect(const char* effect, const char* where, double p, const char* parameter, Estimate e,
                 double gain, int group = 0) {
    Cause c;
    c.effect = effect;
    c.where = where;
    c.p = p;
    c.group = group;
    if (*parameter) c.parameters[parameter] = e;
    c.held_out_gain = gain;
    c.screening_gain = gain * 1.04;
    d.causes.push_back(c);
    return d.causes.back();
  }

  void Others(double p) {
    const char* names[] = {"capstan_alpha", "tendon_stiffness", "routing_friction", "stribeck",
                           "motor_viscous", "cell_gain",        "base_tilt",        "hole_radius"};
    for (const char* name : names) {
      Suspect(name, "all", p, "scale", {1 + 0.4 * p, 1 - p, 1 + 2 * p}, 0.3 * p);
      p *= 0.55;
    }
  }

  // Held-out runs: tension loops of two tendons and the tip in time, with a gap that the cause removes to
  // `left`.
  void Curves(double gap_N, double gap_m, double left, bool after, double seconds = 40) {
    const double rate = 250;
    const int samples = static_cast<int>(seconds * rate);
    for (int j = 1; j <= 2; ++j) {
      Overlay o;
      o.run = "circle_2.csv";
      o.channel = fmt::format("tension {}", j);
      o.unit = "N";
      o.cut = Cut::kDrivetrain;
      o.floor = 0.031;
      o.against = fmt::format("displacement {}", j);
      o.against_unit = "m";
      for (int i = 0; i < samples; ++i) {
        const double t = i / rate, phase = 2 * kPi * t / 10 + 1.6 * j;
        const double x = 4e-3 * std::sin(phase) * (1 + 0.3 * std::sin(0.11 * t));
        const double friction = std::tanh(6 * std::cos(phase));
        const double base = 3.2 + 420 * x + 0.25 * friction;
        o.time_s.push_back(t);
        o.x.push_back(x);
        o.measured.push_back(base + gap_N * friction * (j == 1 ? 0.4 : 1) + Noise(0.02));
        o.before.push_back(base);
        if (after) o.after.push_back(base + (1 - left) * gap_N * friction * (j == 1 ? 0.4 : 1));
      }
      d.overlays.push_back(std::move(o));
    }
    for (int axis = 0; axis < 3; ++axis) {
      Overlay o;
      o.run = axis == 2 ? "steps_1.csv" : "circle_2.csv";
      o.channel = fmt::format("tip {}", "xyz"[axis]);
      o.unit = "m";
      o.cut = Cut::kShape;
      o.floor = 3.2e-4;
      for (int i = 0; i < samples; ++i) {
        const double t = i / rate, phase = 2 * kPi * t / 10 + 0.5 * kPi * axis;
        const double shape = axis == 2 ? 0.09 - 0.01 * std::pow(std::sin(phase), 2) : 0.035 * std::sin(phase);
        const double error = gap_m * (0.6 * std::sin(phase) + 0.4 * std::tanh(5 * std::cos(phase)));
        o.time_s.push_back(t);
        o.measured.push_back(shape + error + Noise(1.5e-4));
        o.before.push_back(shape);
        if (after) o.after.push_back(shape + (1 - left) * error);
      }
      d.overlays.push_back(std::move(o));
    }
  }

  void Maps(double gap_N, double gap_m, double left, bool after) {
    const struct {
      Cut cut;
      const char *channel, *unit, *condition, *condition_unit;
      double reach, size, noise;
    } kinds[] = {
        {Cut::kDrivetrain, "tension 2", "N", "speed of the tendon", "m/s", 8e-3, gap_N, 0.01},
        {Cut::kDrivetrain, "tension 2", "N", "tension", "N", 8, 0.2 * gap_N, 0.01},
        {Cut::kDrivetrain, "tension 3", "N", "speed of the tendon", "m/s", 8e-3, 0.6 * gap_N, 0.01},
        {Cut::kDrivetrain, "tension 3", "N", "spool angle", "rad", 9, 0.1 * gap_N, 0.01},
        {Cut::kShape, "tip position", "m", "curvature", "1/m", 14, gap_m, 1e-4},
        {Cut::kShape, "tip position", "m", "direction of bending", "rad", 3.1, 0.3 * gap_m, 1e-4},
        {Cut::kShape, "tip direction", "rad", "time", "s", 40, gap_m * 12, 1e-3},
    };
    for (const auto& k : kinds) {
      ConditionMap m;
      m.cut = k.cut;
      m.channel = k.channel;
      m.unit = k.unit;
      m.condition = k.condition;
      m.condition_unit = k.condition_unit;
      for (int i = 0; i < 17; ++i) {
        const double s = i / 8.0 - 1, mean = k.size * std::tanh(4 * s) + Noise(0.4 * k.noise);
        m.at.push_back(k.reach * s);
        m.mean.push_back(mean);
        m.low.push_back(mean - k.noise * (1.2 + s * s));
        m.high.push_back(mean + k.noise * (1.2 + s * s));
        if (after) m.after.push_back(left * mean + Noise(0.3 * k.noise));
      }
      d.maps.push_back(m);
    }
  }

  void Close(const std::string& channel, const char* unit, Cut cut, double before, double after, double floor,
             bool judged) {
    Closure c;
    c.channel = channel;
    c.unit = unit;
    c.cut = cut;
    c.before_rms = before;
    c.after_rms = judged ? after : before;
    c.floor_rms = floor;
    if (judged && before > 1.05 * floor) {
      const double v = 1 - (after * after - floor * floor) / (before * before - floor * floor);
      c.closed = Estimate{v, v - 0.05, std::min(1.0, v + 0.03)};
      c.ceiling_rms = floor + 0.6 * (after - floor);
    }
    d.closures.push_back(c);
  }

  void Families() {
    d.families = {{"circle", 2, 4.1e-3, 0.4e-3, 0.21e-3, Estimate{0.99, 0.97, 1}},
                  {"triangle", 1, 0.2e-3, 0.2e-3, 0.21e-3, std::nullopt}};
  }

  void Provenance() {
    d.robot_name = "one_section";
    d.robot_yaml =
        "robot:\n  name: one_section\n  sections:\n    - units: 4\n      unit_length_m: 0.0225\n"
        "      youngs_modulus_Pa: 5.8e10\n";
    const char* families[] = {"triangle", "circle", "steps", "multisine", "ladder"};
    for (int i = 0; i < 8; ++i) {
      RunSummary r;
      r.name = fmt::format("{}_{}.csv", families[i % 5], i / 5 + 1);
      r.family = families[i % 5];
      if (i >= 5) r.repeat_of = fmt::format("{}_1.csv", families[i % 5]);
      r.sha256 = fmt::format("{:016x}{:016x}{:016x}{:016x}", random(), random(), random(), random());
      r.duration_s = 40;
      r.rate_Hz = 1000;
      r.samples = 40000;
      d.runs.push_back(r);
    }
    d.held_out_families = {"circle", "steps"};
    d.held_out_by = "kinds of motion";
    d.delta_N = 0.06;
    d.delta_m = 5e-4;
    d.seed = 18446744073709551615ull;
    d.version = "0.1.0";
    d.revision = "a1b2c3d4e5f6";
    d.command = "tendril gap diagnose --robot one_section.yaml runs --seed 18446744073709551615";
    d.seconds = 17.25;
    for (int i = 0; i < 7; ++i) {
      const double h = 0.02 * std::pow(2, i);
      d.horizon.push_back({h, 2e-4 + 1.1e-3 * std::sqrt(h), 2.4e-4 + 1e-5 * i});
    }
    d.free_runs = {{"circle_1", "circle", 10, 0.0123, 0.0042, 0.0006},
                   {"steps_1", "steps", 10, 0.009, 0.0031, {}}};
    d.health.push_back(
        {HealthFinding::Severity::kInfo, "", "", 0.93,
         "Repeats agree to 0.31 mm and 0.031 N: the noise floor is taken from 3 pairs of repeated runs."});
  }

  void Rivals(bool alike) {
    const char* names[] = {"stribeck all",        "motor_coulomb tendon:2", "capstan_alpha all",
                           "gear_efficiency all", "routing_friction all",   "backbone_hysteresis all"};
    for (int i = 0; i < 6; ++i) {
      for (int k = i + 1; k < 6; ++k) {
        Confusion c;
        c.a = names[i];
        c.b = names[k];
        c.cosine = i == 2 && k == 3 && alike ? 0.987 : (k - i == 1 ? 0.72 : 0.35) * ((i + k) % 3 ? 1 : -0.6);
        c.profile_gap = std::abs(c.cosine) > 0.95 ? 0.2 : 6 * (1 - std::abs(c.cosine));
        c.confirmed = std::abs(c.cosine) > 0.95;
        d.confusable.push_back(c);
      }
    }
    for (int k = 0; k < 3; ++k) {
      Profile p{k == 0   ? "motor_coulomb"
                : k == 1 ? "capstan_alpha"
                         : "tip_payload",
                k == 0 ? "tendon:2" : "all",
                k == 2 ? "mass_kg" : "scale",
                {},
                {}};
      for (int i = 0; i < 21; ++i) {
        const double s = (i - 10) / 10.0;
        p.value.push_back(k == 2 ? 0.02 + 0.015 * s : 1.8 + 0.6 * s);
        p.score.push_back((k == 1 && alike ? 1.5 : 40) * s * s + 0.3 * std::abs(s));
      }
      d.profiles.push_back(p);
    }
  }
};

}  // namespace

Diagnosis ExampleDiagnosis(Verdict verdict) {
  Maker m;
  Diagnosis& d = m.d;
  d.verdict = verdict;
  m.Families();
  m.Provenance();
  switch (verdict) {
    case Verdict::kAttributed: {
      d.sentence =
          "The gap starts in the drivetrain (C2) of tendons 2 and 3: the motors' dry friction is 1.84 times "
          "what the "
          "robot file says (96 % sure), and adding it closes 93 % of the gap on held-out runs, from 0.38 N "
          "to 0.041 N; "
          "no further experiment is needed.";
      m.Chain(Cut::kDrivetrain, 12.3, true, 0.5);
      Cause c = m.Suspect("motor_coulomb", "tendon:2", 0.962, "scale", {1.84, 1.79, 1.90}, 0.93);
      m.Others(0.014);
      m.Suspect("unknown", "", 0.009, "", {}, 0);
      m.Suspect("no_gap", "", 0.0, "", {}, 0);
      d.accepted = {c};
      d.closed = Estimate{0.931, 0.902, 0.952};
      d.closed_ceiling = Estimate{0.953, 0.93, 0.97};
      for (int j = 1; j <= kTendons; ++j) {
        const bool here = j == 2 || j == 3;
        m.Close(fmt::format("tension {} from torque", j), "N", Cut::kDrivetrain,
                here ? (j == 2 ? 0.382 : 0.23) : 0.0315, here ? 0.041 : 0.0315, 0.031, true);
      }
      m.Close("tip position", "m", Cut::kShape, 2.1e-3, 4.4e-4, 3.2e-4, true);
      m.Close("tip in motion", "m", Cut::kMotion, 2.4e-3, 6e-4, 4e-4, true);
      m.Close("tip direction", "rad", Cut::kShape, 0.021, 0.0075, 0.006, true);
      m.Curves(0.4, 2.5e-3, 0.08, true);
      m.Maps(0.4, 2.2e-3, 0.06, true);
      m.Rivals(false);
      d.leftover_sigma = 0.12;
      d.input_correlations = {
          {"speed of tendon 2", 0.08}, {"tension 2", -0.05}, {"acceleration 2", 0.02}, {"time", 0.04}};
      break;
    }
    case Verdict::kAmbiguousGroup: {
      d.sentence =
          "The gap starts in the drivetrain (C2) of all tendons and closes by 88 % with either a higher "
          "friction of the "
          "pulleys (capstan_alpha) or a lower efficiency of the gears (gear_efficiency): these runs cannot "
          "tell the two "
          "apart (together 91 %). Run slow reversals at three tensions next; they would separate them by 9 "
          "sigma.";
      m.Chain(Cut::kDrivetrain, 5.4);
      Cause a = m.Suspect("capstan_alpha", "all", 0.52, "scale", {1.31, 1.22, 1.40}, 0.88, 1);
      Cause b = m.Suspect("gear_efficiency", "all", 0.39, "scale", {0.91, 0.88, 0.94}, 0.87, 1);
      m.Others(0.03);
      m.Suspect("unknown", "", 0.03, "", {}, 0);
      m.Suspect("no_gap", "", 0.001, "", {}, 0);
      d.accepted = {a};
      d.closed = Estimate{0.88, 0.83, 0.91};
      d.closed_ceiling = Estimate{0.9, 0.86, 0.93};
      for (int j = 1; j <= kTendons; ++j) {
        m.Close(fmt::format("tension {}", j), "N", Cut::kDrivetrain, 0.17 + 0.01 * j, 0.06, 0.031, true);
      }
      m.Close("tip position", "m", Cut::kShape, 1.2e-3, 4.8e-4, 3.2e-4, true);
      m.Curves(0.18, 1.2e-3, 0.12, true);
      m.Maps(0.18, 1e-3, 0.1, true);
      m.Rivals(true);
      d.leftover_sigma = 0.22;
      d.input_correlations = {{"speed of tendon 1", 0.11}, {"tension 1", -0.16}, {"time", 0.02}};
      d.next.family = "reversals_three_tensions";
      d.next.reason =
          "Friction of the pulleys grows with the wrap and the tension behind them, a loss in the gear with "
          "the "
          "torque alone: slow reversals at three levels of co-contraction pull the two apart.";
      d.next.separation_sigma = 9.2;
      d.next.yaml =
          "# tendril excite --plan plan.yaml\nrobot: one_section\nruns:\n  - family: "
          "reversals_three_tensions\n"
          "    amplitude_rad: 0.6\n    period_s: 12\n    pretension_N: [0.5, 2.0, 4.0]\n    repeats: 2\n";
      d.next.alternatives = {{"circle", 2.1}, {"speed_ladder", 1.4}, {"multisine", 0.8}, {"long_hold", 0.1}};
      break;
    }
    case Verdict::kUnexplained:
      d.sentence =
          "The gap starts in the robot's shape (C4), and no effect of the library explains it: the best of "
          "them, backbone "
          "hysteresis, closes 41 % and leaves 3.1 sigma that still follow the bending. Look at the loops "
          "below for what "
          "the backbone does at its turning points.";
      m.Chain(Cut::kShape, 7.7);
      m.Suspect("unknown", "", 0.86, "", {}, 0);
      m.Suspect("backbone_hysteresis", "all", 0.08, "moment_Nm", {0.004, 0.001, 0.02}, 0.41).bound_hit = true;
      m.Others(0.02);
      m.Suspect("no_gap", "", 0.0, "", {}, 0);
      d.closed = Estimate{0.41, 0.22, 0.5};
      d.closed_ceiling = Estimate{0.78, 0.7, 0.82};
      m.Close("tip position", "m", Cut::kShape, 2.6e-3, 2.02e-3, 3.2e-4, true);
      m.Close("tip direction", "rad", Cut::kShape, 0.05, 0.039, 0.006, true);
      m.Curves(0.02, 3e-3, 0.6, true);
      m.Maps(0.02, 3e-3, 0.6, true);
      m.Rivals(false);
      d.leftover_sigma = 3.1;
      d.input_correlations = {
          {"bending us", 0.71}, {"bending vs", -0.44}, {"speed of bending", 0.2}, {"time", 0.05}};
      d.next.reason =
          "No run of the menu separates the remaining explanations: the library lacks the effect.";
      d.health.push_back(
          {HealthFinding::Severity::kWarning, "steps_1.csv", "torque 3", 0.04,
           "4 % of the samples are at the drive's torque limit; what depends on this torque is left out "
           "there. Use smaller steps."});
      break;
    case Verdict::kNoGap:
      d.sentence =
          "There is no gap: on all seven places of the chain the simulation misses the robot by no more than "
          "the robot "
          "misses itself when a run is repeated (0.31 mm at the tip, 0.03 N in the tendons).";
      m.Chain(Cut::kSensors, 0);
      m.Suspect("no_gap", "", 0.69, "", {}, 0);
      m.Others(0.25);
      m.Suspect("unknown", "", 0.06, "", {}, 0);
      for (int j = 1; j <= kTendons; ++j) {
        m.Close(fmt::format("tension {}", j), "N", Cut::kDrivetrain, 0.0315 + 0.0004 * j, 0, 0.031, false);
      }
      m.Close("tip position", "m", Cut::kShape, 3.25e-4, 0, 3.2e-4, false);
      m.Curves(0, 0, 1, false);
      m.Maps(0.001, 1e-5, 1, false);
      break;
    case Verdict::kInsufficientData:
      d.sentence =
          "These logs cannot settle it: there is no tracker and only one run, so nothing can be held out. "
          "Record the "
          "standard set (tendril excite) with at least one repeat.";
      m.Chain(Cut::kSensors, 0, false);
      m.Suspect("no_gap", "", 0.4, "", {}, 0);
      m.Suspect("unknown", "", 0.3, "", {}, 0);
      m.Others(0.1);
      d.runs.resize(1);
      d.horizon.clear();
      d.free_runs.clear();
      d.held_out_families = {"first quarter", "second quarter", "third quarter", "last quarter"};
      d.held_out_by = "quarters of the runs";
      d.next.family = "standard_set";
      d.next.reason =
          "Two families with a repeat each are the least with which a cause can be tested on held-out runs.";
      d.next.yaml = "runs:\n  - family: triangle\n    repeats: 2\n  - family: circle\n    repeats: 2\n";
      d.health = {
          {HealthFinding::Severity::kError, "triangle_1.csv", "tension 3", 0,
           "The load cell of tendon 3 reads 0.42 N throughout: it is not connected or its channel is wrong. "
           "Tendon 3 is judged without it."},
          {HealthFinding::Severity::kWarning, "triangle_1.csv", "", 0.012,
           "No run is repeated: the noise floor is estimated from differences at high frequency and is too "
           "low "
           "where the robot does not repeat itself."},
          {HealthFinding::Severity::kInfo, "triangle_1.csv", "", 3,
           "3 gaps, the longest of 12 ms, were bridged."}};
      d.degradations = {
          "No tracker: shape and motion (C4, C5) cannot be compared; a payload and a wrong E look alike.",
          "One run only: no run can be held out, so no cause is accepted.",
          "No repeats: the noise floor is a guess from high frequencies."};
      break;
  }
  return d;
}

}  // namespace tendril::gap
