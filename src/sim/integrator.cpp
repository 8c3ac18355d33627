// CVODE with a matrix-embedded linear solver: the system solves its own Newton equations, whose structure it
// knows. Knows nothing of robots.
#include "integrator.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace tendril::sim {

struct IntegratorCallbacks {
  static int Derivative(realtype t, N_Vector y, N_Vector derivative, void* self) {
    auto* integrator = static_cast<Integrator*>(self);
    return integrator->system_.Derivative(t, N_VGetArrayPointer(y), N_VGetArrayPointer(derivative)) ? 0 : 1;
  }
  static int Weights(N_Vector y, N_Vector weights, void* self) {
    const auto& tolerances = static_cast<Integrator*>(self)->tolerances_;
    const Eigen::Map<const Eigen::ArrayXd> value(N_VGetArrayPointer(y), N_VGetLength(y));
    Eigen::Map<Eigen::ArrayXd>(N_VGetArrayPointer(weights), value.size()) =
        (tolerances.relative * value.abs() + tolerances.absolute.array()).inverse();
    return 0;
  }
  static SUNLinearSolver_Type Type(SUNLinearSolver) { return SUNLINEARSOLVER_MATRIX_EMBEDDED; }
  static int Solve(SUNLinearSolver solver, SUNMatrix, N_Vector x, N_Vector b, realtype) {
    auto* integrator = static_cast<Integrator*>(solver->content);
    realtype gamma = 0;
    CVodeGetCurrentGamma(integrator->cvode_, &gamma);
    return integrator->system_.SolveNewton(gamma, N_VGetArrayPointer(b), N_VGetArrayPointer(x)) ? 0 : 1;
  }
  static void Message(int, const char*, const char*, char* text, void* self) {
    static_cast<Integrator*>(self)->reason_ = text;
  }
};

namespace {

void Check(int flag, const char* what) {
  if (flag != CV_SUCCESS) throw std::runtime_error(fmt::format("integrator: {} failed ({})", what, flag));
}

// With some tens of states CVODE spends its time in vector operations, one library call each. These are the
// same operations, inlined and vectorised; cloned vectors inherit them.
using Array = Eigen::Map<Eigen::ArrayXd>;
Array Values(N_Vector v) { return {NV_DATA_S(v), NV_LENGTH_S(v)}; }

void LinearSum(realtype a, N_Vector x, realtype b, N_Vector y, N_Vector z) {
  Values(z) = a * Values(x) + b * Values(y);
}
void Scale(realtype c, N_Vector x, N_Vector z) { Values(z) = c * Values(x); }
void Fill(realtype c, N_Vector z) { Values(z) = c; }
realtype WrmsNorm(N_Vector x, N_Vector w) { return std::sqrt((Values(x) * Values(w)).square().mean()); }
int LinearCombination(int count, realtype* c, N_Vector* x, N_Vector z) {
  Array sum = Values(z);  // may be x[0]
  sum = c[0] * Values(x[0]);
  for (int i = 1; i < count; ++i) sum += c[i] * Values(x[i]);
  return 0;
}
int ScaleAddMulti(int count, realtype* a, N_Vector x, N_Vector* y, N_Vector* z) {
  for (int i = 0; i < count; ++i) Values(z[i]) = a[i] * Values(x) + Values(y[i]);
  return 0;
}

void UseInlinedOperations(N_Vector v) {
  v->ops->nvlinearsum = LinearSum;
  v->ops->nvscale = Scale;
  v->ops->nvconst = Fill;
  v->ops->nvwrmsnorm = WrmsNorm;
  v->ops->nvlinearcombination = LinearCombination;
  v->ops->nvscaleaddmulti = ScaleAddMulti;
}

}  // namespace

Integrator::Integrator(OdeSystem& system, const Eigen::VectorXd& y0, const Tolerances& tolerances,
                       double longest_step, bool vibrates)
    : system_(system), tolerances_(tolerances), y_(y0) {
  Check(SUNContext_Create(nullptr, &context_), "SUNContext_Create");
  vector_ = N_VMake_Serial(y_.size(), y_.data(), context_);
  UseInlinedOperations(vector_);
  error_ = N_VClone(vector_);
  weights_ = N_VClone(vector_);
  linear_ = SUNLinSolNewEmpty(context_);
  linear_->content = this;
  linear_->ops->gettype = IntegratorCallbacks::Type;
  linear_->ops->solve = IntegratorCallbacks::Solve;
  cvode_ = CVodeCreate(CV_BDF, context_);
  if (cvode_ == nullptr) throw std::runtime_error("integrator: CVodeCreate failed");
  Check(CVodeInit(cvode_, IntegratorCallbacks::Derivative, t_, vector_), "CVodeInit");
  Check(CVodeSetErrHandlerFn(cvode_, IntegratorCallbacks::Message, this), "CVodeSetErrHandlerFn");
  Check(CVodeSetUserData(cvode_, this), "CVodeSetUserData");
  Check(CVodeWFtolerances(cvode_, IntegratorCallbacks::Weights), "CVodeWFtolerances");
  Check(CVodeSetMaxStep(cvode_, longest_step), "CVodeSetMaxStep");
  Check(CVodeSetLinearSolver(cvode_, linear_, nullptr), "CVodeSetLinearSolver");
  Check(CVodeSetStabLimDet(cvode_, vibrates), "CVodeSetStabLimDet");
}

Integrator::~Integrator() {
  CVodeFree(&cvode_);
  SUNLinSolFreeEmpty(linear_);
  N_VDestroy(weights_);
  N_VDestroy(error_);
  N_VDestroy(vector_);
  SUNContext_Free(&context_);
}

void Integrator::StepTowards(double end) {
  double first_step = 1e-6;
  while (true) {
    // The remaining interval is divided into equal steps no longer than CVODE's next step.
    const double rest = end - t_;
    const double pieces = next_step_ > 0 ? std::ceil(rest / next_step_ - 0.1) : 1;
    CVodeSetStopTime(cvode_, pieces > 1 ? t_ + rest / pieces : end);
    const int flag = CVode(cvode_, end, vector_, &t_, CV_ONE_STEP);
    if (flag >= 0) {
      next_step_ = NextStep(flag == CV_TSTOP_RETURN);
      return;
    }
    if (first_step < 1e-10) {
      throw std::runtime_error(fmt::format("integration stopped at t = {:.6f} s: {}", t_, reason_));
    }
    Restart(first_step);
    first_step *= 1e-2;
  }
}

// At a stop CVODE does not report its next step; its own rule gives it from the error estimate.
double Integrator::NextStep(bool stopped) {
  realtype step = 0;
  if (!stopped) {
    CVodeGetCurrentStep(cvode_, &step);
    return step;
  }
  int order = 1;
  CVodeGetLastStep(cvode_, &step);
  CVodeGetLastOrder(cvode_, &order);
  CVodeGetEstLocalErrors(cvode_, error_);
  CVodeGetErrWeights(cvode_, weights_);
  const double error = N_VWrmsNorm(error_, weights_);
  const double growth = 1 / (std::pow(6 * error, 1.0 / (order + 1)) + 1e-6);
  return growth < 1.5 ? step : step * std::min(growth, 10.0);
}

void Integrator::Restart(double first_step) {
  const Counters now = counters();
  before_restart_ = now;
  next_step_ = 0;
  ++before_restart_.restarts;
  Check(CVodeReInit(cvode_, t_, vector_), "CVodeReInit");
  Check(CVodeSetInitStep(cvode_, first_step), "CVodeSetInitStep");
}

Integrator::Counters Integrator::SolverCounters() const {
  Counters c;
  CVodeGetNumSteps(cvode_, &c.steps);
  CVodeGetNumRhsEvals(cvode_, &c.derivatives);
  CVodeGetNumNonlinSolvIters(cvode_, &c.newton);
  CVodeGetNumErrTestFails(cvode_, &c.error_test_failures);
  CVodeGetNumNonlinSolvConvFails(cvode_, &c.convergence_failures);
  return c;
}

Integrator::Counters Integrator::counters() const {
  Counters c = SolverCounters();
  c.steps += before_restart_.steps;
  c.derivatives += before_restart_.derivatives;
  c.newton += before_restart_.newton;
  c.error_test_failures += before_restart_.error_test_failures;
  c.convergence_failures += before_restart_.convergence_failures;
  c.restarts = before_restart_.restarts;
  return c;
}

}  // namespace tendril::sim
