// Cuts available from the recorded signals; see the header.
#include "tendril/gap/cuts.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>

#include "postures/learn_postures.h"
#include "prepare.h"

namespace tendril::gap {
namespace {

using sim::Cut;

bool Measured(const Run& run, const Eigen::MatrixXd& values, Eigen::Index column) {
  return values.rows() == run.time_s.size() && column < values.cols() &&
         values.col(column).array().isFinite().any();
}
bool Measured(const Run& run, const Eigen::MatrixXd& values) {
  return values.rows() == run.time_s.size() && values.cols() > 0 && values.array().isFinite().any();
}

/// One requirement of a cut, for a tendon (from 0).
struct Need {
  const char* channel;
  bool (*met)(const Run& run, int tendon);
};

bool HasTension(const Run& run, int tendon) {
  return run.load_cell != LoadCellPlace::kNone && Measured(run, run.tension_N, tendon);
}
constexpr Need kTarget{"target torque",
                       [](const Run& run, int j) { return Measured(run, run.torque_target_Nm, j); }};
constexpr Need kActual{"actual torque",
                       [](const Run& run, int j) { return Measured(run, run.torque_actual_Nm, j); }};
constexpr Need kMotor{"motor position",
                      [](const Run& run, int j) { return Measured(run, run.motor_position_rad, j); }};
constexpr Need kTension{"tension", HasTension};
/// Needed for every tendon: without it the load on the body is unknown.
constexpr Need kPull{"tension or motor position of every tendon", [](const Run& run, int) {
                       const Eigen::Index tendons =
                           std::max(run.tension_N.cols(), run.motor_position_rad.cols());
                       for (int j = 0; j < tendons; ++j) {
                         if (!HasTension(run, j) && !kMotor.met(run, j)) return false;
                       }
                       return tendons > 0;
                     }};
constexpr Need kShape{"tip position, orientation or bending", [](const Run& run, int) {
                        return Measured(run, run.tip_m) || Measured(run, run.tip_quaternion) ||
                               Measured(run, run.bending_rad);
                      }};
constexpr Need kQuick{"rows closer than 0.2 s", [](const Run& run, int) {
                        static_assert(kQuasiStatic_s == 0.2);
                        return run.time_s.size() > 1 && UsualStep(run) <= kQuasiStatic_s;
                      }};

static_assert(kLeastRows == 20 && kLeastStates == 5);
constexpr Need kLong{"run of 20 rows or 5 states at rest", [](const Run& run, int) {
                       return run.time_s.size() > 1 && run.time_s.size() >= LeastRows(run);
                     }};

struct CutNeeds {
  Cut cut;
  bool a_tendon;
  std::array<const Need*, 4> needs;  // null after the last
};
constexpr CutNeeds kCutNeeds[] = {
    {Cut::kClock, false, {}},
    {Cut::kCurrentLoop, true, {&kTarget, &kActual, &kPull, &kLong}},
    {Cut::kDrivetrain, true, {&kActual, &kMotor, &kLong}},
    {Cut::kTendon, true, {&kTension, &kMotor, &kLong}},
    {Cut::kShape, false, {&kPull, &kShape, &kLong}},
    {Cut::kMotion, false, {&kPull, &kShape, &kQuick, &kLong}},
    {Cut::kSensors, true, {&kActual, &kTension, &kMotor, &kLong}},
};

/// What a run lacks for one tendon.
std::vector<const char*> Lacks(const CutNeeds& needs, const Run& run, int tendon) {
  std::vector<const char*> lacks;
  for (const Need* need : needs.needs) {
    if (need != nullptr && !need->met(run, tendon)) lacks.push_back(need->channel);
  }
  return lacks;
}

std::string Listed(const std::vector<const char*>& words) {
  std::string text;
  for (std::size_t i = 0; i < words.size(); ++i)
    text += (i == 0 ? "" : i + 1 == words.size() ? " and no " : ", no ") + std::string(words[i]);
  return text;
}

bool CanBeLearned(const DataSet& set) {
  std::vector<const Run*> runs;
  for (const Run& run : set.runs) runs.push_back(&run);
  return ShowsPostures(set) && EnoughPostures(runs, set.robot);
}

}  // namespace

std::vector<CutOfSet> CutsOf(const DataSet& set) {
  std::vector<CutOfSet> cuts;
  for (const CutNeeds& needs : kCutNeeds) {
    CutOfSet cut{needs.cut, {}, {}};
    // The run and tendon that lack least.
    std::vector<const char*> least;
    bool any = false;
    for (int j = 0; j < (needs.a_tendon ? set.robot.body.tendons() : 1); ++j) {
      bool allowed = false;
      for (const Run& run : set.runs) {
        const std::vector<const char*> lacks = Lacks(needs, run, j);
        allowed = allowed || lacks.empty();
        if (!any || lacks.size() < least.size()) least = lacks, any = true;
      }
      if (!allowed) cut.without.push_back(j + 1);
    }
    cut.lacks = Listed(least);
    if (!cut.allowed() || !needs.a_tendon) cut.without.clear();
    cut.with_before = needs.cut == Cut::kShape && !cut.allowed() && CanBeLearned(set);
    cuts.push_back(std::move(cut));
  }
  return cuts;
}

bool AnyCut(const std::vector<CutOfSet>& cuts) {
  return std::any_of(cuts.begin(), cuts.end(), [](const CutOfSet& c) {
    return (c.allowed() && c.cut != Cut::kClock) || c.with_before;
  });
}

std::string CutsLine(const std::vector<CutOfSet>& cuts) {
  std::string can, cannot;
  for (const CutOfSet& cut : cuts) {
    const std::string name(sim::CutName(cut.cut));
    if (cut.with_before) {
      can += fmt::format("{}{} (with runs from before a change: --before)", can.empty() ? "" : ", ", name);
      continue;
    }
    if (!cut.allowed()) {
      cannot += fmt::format("{}{} (no {})", cannot.empty() ? "" : ", ", name, cut.lacks);
      continue;
    }
    can += (can.empty() ? "" : ", ") + name;
    if (cut.without.empty()) continue;
    std::string tendons;
    for (const int j : cut.without) tendons += (tendons.empty() ? "" : ", ") + std::to_string(j);
    can += fmt::format(" (not tendon{} {})", cut.without.size() == 1 ? "" : "s", tendons);
  }
  return "can be compared: " + (can.empty() ? "nothing" : can) + (cannot.empty() ? "" : "; not " + cannot);
}

}  // namespace tendril::gap
