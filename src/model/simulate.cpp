// CVODE around the body's forward dynamics, restarted where the tensions' slope jumps.
// Knows nothing of files or of where the tensions come from.
#include "tendril/model/simulate.h"

#include <cvode/cvode.h>
#include <nvector/nvector_serial.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <string>

namespace tendril::model {
namespace {

using Eigen::Map;
using Eigen::VectorXd;

void Require(bool ok, const char* what) {
  if (!ok) throw std::invalid_argument(std::string("simulation: ") + what);
}

void Check(int flag, const char* what, double time_s) {
  if (flag < 0) {
    throw std::runtime_error(std::string("simulation: ") + what + " failed at t = " + std::to_string(time_s) +
                             " s (CVODE " + CVodeGetReturnFlagName(flag) + ")");
  }
}

struct Motion {
  Motion(const Body& b, const TensionProfile& p)
      : body(b),
        profile(p),
        workspace(b),
        tension(b.tendons()),
        slope(b.tendons()),
        pull(b.tendons()),
        force(b.dof()) {}

  // Tensions from knot k on.
  void Enter(Eigen::Index k) {
    start_s = profile.time_s[k];
    tension = profile.tension_N.col(k);
    slope.setZero();
    if (k + 1 < profile.time_s.size()) slope = SlopeAfter(k);
  }
  VectorXd SlopeAfter(Eigen::Index k) const {
    return (profile.tension_N.col(k + 1) - profile.tension_N.col(k)) /
           (profile.time_s[k + 1] - profile.time_s[k]);
  }

  const Body& body;
  const TensionProfile& profile;
  Body::Workspace workspace;
  double start_s = 0;
  VectorXd tension, slope, pull, force;
};

int Rate(double t, N_Vector y, N_Vector dy, void* data) {
  Motion& m = *static_cast<Motion*>(data);
  const int n = m.body.dof();
  const double* const state = N_VGetArrayPointer(y);
  double* const rate = N_VGetArrayPointer(dy);
  const Map<const VectorXd> q(state, n), dq(state + n, n);
  Map<VectorXd>(rate, n) = dq;
  Map<VectorXd> ddq(rate + n, n);
  m.pull = m.tension + (t - m.start_s) * m.slope;
  m.body.TendonForce(q, m.pull, m.force);
  m.body.ForwardDynamics(q, dq, m.force, ddq, m.workspace);
  return ddq.allFinite() ? 0 : 1;
}

struct Free {
  void operator()(SUNContext c) const { SUNContext_Free(&c); }
  void operator()(N_Vector v) const { N_VDestroy(v); }
  void operator()(SUNMatrix a) const { SUNMatDestroy(a); }
  void operator()(SUNLinearSolver s) const { SUNLinSolFree(s); }
  void operator()(SUNNonlinearSolver s) const { SUNNonlinSolFree(s); }
};
template <class Handle>
using Owned = std::unique_ptr<std::remove_pointer_t<Handle>, Free>;
struct FreeCvode {
  void operator()(void* memory) const { CVodeFree(&memory); }
};

}  // namespace

void Simulate(const Body& body, const TensionProfile& profile, ConstVectorRef initial_q,
              ConstVectorRef initial_dq, double step_s, double relative_tolerance,
              const std::function<void(double time_s, ConstVectorRef q, ConstVectorRef dq)>& sample) {
  const Eigen::Index n = body.dof(), knots = profile.time_s.size();
  Require(knots >= 1 && profile.tension_N.cols() == knots,
          "needs one column of tensions per knot, at least one");
  Require(profile.tension_N.rows() == body.tendons(), "needs one tension per tendon");
  Require(profile.time_s.allFinite() && profile.tension_N.allFinite(), "times and tensions must be finite");
  for (Eigen::Index k = 1; k < knots; ++k) {
    Require(profile.time_s[k] > profile.time_s[k - 1], "times must increase from knot to knot");
  }
  Require(initial_q.size() == n && initial_dq.size() == n,
          "the initial state needs u, v, du, dv of every unit");
  Require(initial_q.allFinite() && initial_dq.allFinite(), "the initial state must be finite");
  Require(std::isfinite(step_s) && step_s > 0, "the output step must be positive");
  Require(relative_tolerance >= 1e-14 && relative_tolerance <= 0.1,
          "the tolerance must be within 1e-14..0.1");

  const double first_s = profile.time_s[0], last_s = profile.time_s[knots - 1];
  // A grid point beyond the last knot by rounding counts as the last knot.
  const auto samples =
      static_cast<std::int64_t>(std::floor((last_s - first_s) / step_s * (1 + 1e-12) + 1e-9));
  sample(first_s, initial_q, initial_dq);
  if (samples == 0) return;

  SUNContext raw_context = nullptr;
  Check(SUNContext_Create(nullptr, &raw_context), "start", first_s);
  const Owned<SUNContext> context(raw_context);
  const Owned<N_Vector> y(N_VNew_Serial(2 * n, context.get())), floor(N_VNew_Serial(2 * n, context.get()));
  Map<VectorXd> state(N_VGetArrayPointer(y.get()), 2 * n), floors(N_VGetArrayPointer(floor.get()), 2 * n);
  state << initial_q, initial_dq;
  floors.head(n).setConstant(0.01 * relative_tolerance);
  floors.tail(n).setConstant(relative_tolerance);

  // Damping on light disks makes the equations stiff; without it they only oscillate.
  const bool stiff = std::any_of(body.parameters().sections.begin(), body.parameters().sections.end(),
                                 [](const SectionParameters& s) { return s.bending_damping_Nms > 0; });
  Motion motion(body, profile);
  motion.Enter(0);
  const std::unique_ptr<void, FreeCvode> cvode(CVodeCreate(stiff ? CV_BDF : CV_ADAMS, context.get()));
  if (!cvode) throw std::runtime_error("simulation: CVODE could not be created");
  Check(CVodeInit(cvode.get(), Rate, first_s, y.get()), "start", first_s);
  Check(CVodeSetUserData(cvode.get(), &motion), "start", first_s);
  Check(CVodeSVtolerances(cvode.get(), relative_tolerance, floor.get()), "start", first_s);
  Check(CVodeSetMaxNumSteps(cvode.get(), 50'000'000), "start", first_s);
  Owned<SUNMatrix> matrix;
  Owned<SUNLinearSolver> linear;
  Owned<SUNNonlinearSolver> nonlinear;
  if (stiff) {
    matrix.reset(SUNDenseMatrix(2 * n, 2 * n, context.get()));
    linear.reset(SUNLinSol_Dense(y.get(), matrix.get(), context.get()));
    Check(CVodeSetLinearSolver(cvode.get(), linear.get(), matrix.get()), "start", first_s);
  } else {
    nonlinear.reset(SUNNonlinSol_FixedPoint(y.get(), 0, context.get()));
    Check(CVodeSetNonlinearSolver(cvode.get(), nonlinear.get()), "start", first_s);
  }

  double t = first_s;
  Eigen::Index knot = 0, corner = 0;  // current piece; next knot at which the slope jumps
  const auto find_corner = [&] {
    corner = knot + 1;
    while (corner + 1 < knots && motion.SlopeAfter(corner) == motion.slope) ++corner;
    Check(CVodeSetStopTime(cvode.get(), profile.time_s[std::min(corner, knots - 1)]), "restart", t);
  };
  find_corner();
  for (std::int64_t i = 1; i <= samples; ++i) {
    const double goal = std::min(first_s + static_cast<double>(i) * step_s, last_s);
    while (t < goal) {
      const int flag = CVode(cvode.get(), goal, y.get(), &t, CV_NORMAL);
      Check(flag, "integration", t);
      if (flag == CV_TSTOP_RETURN && corner + 1 < knots) {
        knot = corner;
        motion.Enter(knot);
        Check(CVodeReInit(cvode.get(), t, y.get()), "restart", t);
        find_corner();
      }
    }
    sample(goal, state.head(n), state.tail(n));
  }
}

}  // namespace tendril::model
