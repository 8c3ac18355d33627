// The improved Capstan equation solved with CVODE, and its inverse. Knows pulleys and tensions only: nothing
// of motors, directions of motion or pre-sliding.
#include "tendril/model/capstan.h"

#include <cvode/cvode.h>
#include <nvector/nvector_serial.h>
#include <sunlinsol/sunlinsol_band.h>
#include <sunmatrix/sunmatrix_band.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <string>
#include <vector>

#include "capstan_equation.h"

namespace tendril::model {
namespace {

// All solutions are computed in y = ln T and w = T'/T, in which every tension, however small, is equally well
// scaled and errors are relative: y' = w, w' = rho - w^2 - G(y, w), with
//   cumulative: G = (rho / n) w c^(-1/n),   local: G = rho sign(w) |w / c|^(1/n),
//   c = alpha rho / (1 + rho) T^(n-1).
// The sensitivities s = dy/dy(0) and r = dw/dy(0) are integrated along: they are the slopes of the map in
// log-log coordinates.

constexpr int kStates = 4;  // ln T - ln T(0), w, s, r

struct Problem {
  double rho, n, m;  // m = 1/n - 1
  double log_c0;     // ln(alpha rho / (1 + rho))
  bool local;
  std::span<const double> log_start;  // ln T(0) of each solution
};

struct Friction {
  double g, g_w, g_ww;  // G and its derivatives by w; by y every one of them scales with exp(m y)
};

Friction FrictionAt(const Problem& p, double y, double w) {
  const double log_c = p.log_c0 - (1 - p.n) * y;
  if (!p.local) {
    const double rate = p.rho / p.n * std::exp(-log_c / p.n);
    return {rate * w, rate, 0};
  }
  if (w == 0) return {0, p.n == 1 ? p.rho * std::exp(-log_c) : 0, 0};
  const double magnitude = std::abs(w);
  const double power = p.rho * std::exp((std::log(magnitude) - log_c) / p.n);
  const double sign = w > 0 ? 1 : -1;
  return {sign * power, power / (p.n * magnitude), sign * power * p.m / (p.n * magnitude * magnitude)};
}

int Derivative(realtype, N_Vector state, N_Vector derivative, void* data) {
  const auto& p = *static_cast<const Problem*>(data);
  const double* x = N_VGetArrayPointer(state);
  double* dx = N_VGetArrayPointer(derivative);
  for (std::size_t i = 0; i < p.log_start.size(); ++i, x += kStates, dx += kStates) {
    const double w = x[1], s = x[2], r = x[3];
    const Friction f = FrictionAt(p, p.log_start[i] + x[0], w);
    dx[0] = w;
    dx[1] = p.rho - w * w - f.g;
    dx[2] = r;
    dx[3] = -(2 * w + f.g_w) * r - p.m * f.g * s;
    if (!std::isfinite(dx[1]) || !std::isfinite(dx[3]))
      return 1;  // too long a step: CVODE tries a shorter one
  }
  return 0;
}

int Jacobian(realtype, N_Vector state, N_Vector, SUNMatrix jacobian, void* data, N_Vector, N_Vector,
             N_Vector) {
  const auto& p = *static_cast<const Problem*>(data);
  const double* x = N_VGetArrayPointer(state);
  for (std::size_t i = 0; i < p.log_start.size(); ++i, x += kStates) {
    const double w = x[1], s = x[2], r = x[3];
    const Friction f = FrictionAt(p, p.log_start[i] + x[0], w);
    const auto at = static_cast<sunindextype>(i) * kStates;
    SM_ELEMENT_B(jacobian, at, at + 1) = 1;
    SM_ELEMENT_B(jacobian, at + 1, at) = -p.m * f.g;
    SM_ELEMENT_B(jacobian, at + 1, at + 1) = -2 * w - f.g_w;
    SM_ELEMENT_B(jacobian, at + 2, at + 3) = 1;
    SM_ELEMENT_B(jacobian, at + 3, at) = -p.m * f.g_w * r - p.m * p.m * f.g * s;
    SM_ELEMENT_B(jacobian, at + 3, at + 1) = -(2 + f.g_ww) * r - p.m * f.g_w * s;
    SM_ELEMENT_B(jacobian, at + 3, at + 2) = -p.m * f.g;
    SM_ELEMENT_B(jacobian, at + 3, at + 3) = -2 * w - f.g_w;
  }
  return 0;
}

void Silent(int, const char*, const char*, char*, void*) {}

/// One CVODE run over the wrap for all starts at once: they share steps, and the Jacobian is block diagonal.
class Integration {
 public:
  Integration(const Problem& problem, double start_w) : problem_(problem) {
    const auto count = static_cast<sunindextype>(problem_.log_start.size()) * kStates;
    Check(SUNContext_Create(nullptr, &context_));
    state_ = N_VNew_Serial(count, context_);
    tolerance_ = N_VNew_Serial(count, context_);
    matrix_ = SUNBandMatrix(count, 1, 3, context_);
    cvode_ = CVodeCreate(CV_BDF, context_);
    solver_ = SUNLinSol_Band(state_, matrix_, context_);
    if (!state_ || !tolerance_ || !matrix_ || !cvode_ || !solver_)
      throw std::runtime_error("CVODE: out of memory");
    double* x = N_VGetArrayPointer(state_);
    for (sunindextype i = 0; i < count; i += kStates) {
      x[i] = 0;
      x[i + 1] = start_w;
      x[i + 2] = 1;
      x[i + 3] = 0;
    }
  }
  Integration(const Integration&) = delete;
  Integration& operator=(const Integration&) = delete;
  ~Integration() {
    if (cvode_) CVodeFree(&cvode_);
    if (solver_) SUNLinSolFree(solver_);
    if (matrix_) SUNMatDestroy(matrix_);
    if (tolerance_) N_VDestroy(tolerance_);
    if (state_) N_VDestroy(state_);
    if (context_) SUNContext_Free(&context_);
  }

  void Run(double wrap_rad, double relative_tolerance) {
    // A slope error matters a thousand times less than a value error: Hermite cubics multiply it by the node
    // spacing.
    double* tolerance = N_VGetArrayPointer(tolerance_);
    for (sunindextype i = 0; i < N_VGetLength(state_); i += kStates) {
      tolerance[i] = 0.1 * relative_tolerance;
      tolerance[i + 1] = 0.1 * relative_tolerance;
      tolerance[i + 2] = relative_tolerance;
      tolerance[i + 3] = relative_tolerance;
    }
    Check(CVodeInit(cvode_, Derivative, 0, state_));
    Check(CVodeSVtolerances(cvode_, relative_tolerance, tolerance_));
    Check(CVodeSetErrHandlerFn(cvode_, Silent, nullptr));
    Check(CVodeSetUserData(cvode_, &problem_));
    Check(CVodeSetLinearSolver(cvode_, solver_, matrix_));
    Check(CVodeSetJacFn(cvode_, Jacobian));
    Check(CVodeSetMaxNumSteps(cvode_, 1'000'000));
    Check(CVodeSetMaxErrTestFails(cvode_, 20));
    Check(CVodeSetMaxConvFails(cvode_, 50));
    Check(CVodeSetStopTime(cvode_, wrap_rad));
    realtype reached = 0;
    Check(CVode(cvode_, wrap_rad, state_, &reached, CV_NORMAL));
  }

  LogPoint Result(std::size_t i) const {
    const double* x = N_VGetArrayPointer(state_) + i * kStates;
    return {problem_.log_start[i] + x[0], x[2]};
  }

 private:
  static void Check(int flag) {
    if (flag < 0) {
      throw std::runtime_error("Capstan equation: CVODE gave up (" +
                               std::string(CVodeGetReturnFlagName(flag)) + ")");
    }
  }

  Problem problem_;
  SUNContext context_ = nullptr;
  N_Vector state_ = nullptr, tolerance_ = nullptr;
  SUNMatrix matrix_ = nullptr;
  SUNLinearSolver solver_ = nullptr;
  void* cvode_ = nullptr;
};

/// ln(high/low) as the tension goes to zero, which is also its largest value: without friction's
/// tension-dependent damping the equation is T'' = rho T.
double LogRatioAtZero(const PulleyParameters& p) {
  const double root = std::sqrt(p.radius_ratio), a = root * p.wrap_rad;
  const double c = std::cos(p.entry_angle_rad), s = root * std::sin(p.entry_angle_rad);
  return a + std::log(0.5 * ((c + s) + (c - s) * std::exp(-2 * a)));
}

LogPoint SolveLog(const PulleyParameters& pulley, double log_low) {
  LogPoint out;
  SolveLog(pulley, std::span(&log_low, 1), std::span(&out, 1), kSolverTolerance);
  return out;
}

void CheckTension(const char* side, double tension_N) {
  if (!(tension_N >= 0 && tension_N <= kMaxCapstanTension_N)) {
    throw std::invalid_argument(std::string(side) + " tension = " + NumberText(tension_N) +
                                " N: accepted 0 .. 1e6 N");
  }
}

double Finite(double tension_N) {
  if (!std::isfinite(tension_N)) throw std::runtime_error("Capstan equation: the tension exceeds 1e308 N");
  return tension_N;
}

/// ln of the low side for ln of the high side, by Newton with the exact slope inside a bracket. With friction
/// between none (high = low cos(entry)) and its largest (the limit at zero tension) the bracket is known
/// beforehand.
double InvertLog(const PulleyParameters& pulley, double log_high) {
  if (pulley.law == CapstanLaw::kClassic) return log_high - pulley.alpha * pulley.wrap_rad;
  const double log_entry = std::log(std::cos(pulley.entry_angle_rad));
  double upper = log_high - log_entry;
  if (pulley.wrap_rad == 0 || pulley.alpha == 0) return upper;
  double lower = log_high - LogRatioAtZero(pulley);
  double x = upper - std::min(0.5 * (upper - lower), pulley.alpha * pulley.wrap_rad);
  for (int i = 0; i < 100; ++i) {
    const LogPoint f = SolveLog(pulley, x);
    const double error = f.log_high - log_high;
    (error > 0 ? upper : lower) = x;
    double next = x - error / f.slope;
    if (!(next >= lower && next <= upper)) next = 0.5 * (lower + upper);
    const double step = std::abs(next - x);
    x = next;
    if (step <= 1e-13 * std::max(1.0, std::abs(x)) || std::abs(error) < 2e-14) break;
  }
  return x;
}

}  // namespace

void SolveLog(const PulleyParameters& pulley, std::span<const double> log_low, std::span<LogPoint> out,
              double relative_tolerance) {
  if (pulley.law == CapstanLaw::kClassic) {
    for (std::size_t i = 0; i < log_low.size(); ++i)
      out[i] = {log_low[i] + pulley.alpha * pulley.wrap_rad, 1};
    return;
  }
  const double log_entry = std::log(std::cos(pulley.entry_angle_rad));
  if (pulley.wrap_rad == 0 || pulley.alpha == 0) {
    for (std::size_t i = 0; i < log_low.size(); ++i) out[i] = {log_low[i] + log_entry, 1};
    return;
  }
  std::vector<double> start(log_low.begin(), log_low.end());
  for (double& y : start) y += log_entry;
  const double n = pulley.exponent, rho = pulley.radius_ratio;
  const Problem problem{
      rho, n, 1 / n - 1, std::log(pulley.alpha * rho / (1 + rho)), pulley.law == CapstanLaw::kLocal, start};
  const double start_w = rho * std::tan(pulley.entry_angle_rad);
  if (!problem.local) {
    // Friction so small that the tension does not change by one unit in the last place: too stiff to
    // integrate, and no effect.
    const double least_rate = FrictionAt(problem, *std::min_element(start.begin(), start.end()), 1).g_w;
    if ((start_w + rho * pulley.wrap_rad) / least_rate < 1e-17) {
      for (std::size_t i = 0; i < start.size(); ++i) out[i] = {start[i], 1};
      return;
    }
  }
  Integration integration(problem, start_w);
  integration.Run(pulley.wrap_rad, relative_tolerance);
  for (std::size_t i = 0; i < start.size(); ++i) out[i] = integration.Result(i);
}

std::string NumberText(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

void ValidatePulley(const PulleyParameters& p) {
  const auto require = [](bool good, const char* name, double value, const char* range) {
    if (!good) {
      throw std::invalid_argument(std::string("pulley ") + name + " = " + NumberText(value) + ": accepted " +
                                  range);
    }
  };
  require(p.wrap_rad >= 0 && p.wrap_rad <= 100, "wrap", p.wrap_rad, "0 .. 100 rad");
  require(p.alpha >= 0 && p.alpha <= 100, "alpha", p.alpha, "0 .. 100 N^(1-n)");
  if (p.law == CapstanLaw::kClassic) return;
  require(p.radius_ratio > 0 && p.radius_ratio <= 1e12, "rho", p.radius_ratio, "above 0, up to 1e12");
  require(p.exponent >= 0.05 && p.exponent <= 1, "n", p.exponent, "0.05 .. 1");
  require(p.entry_angle_rad >= 0 && p.entry_angle_rad <= 1.5, "phi1", p.entry_angle_rad, "0 .. 1.5 rad");
}

double CapstanLogRatio(std::span<const PulleyParameters> pulleys, double base_tension_N) {
  double sum = 0;
  for (const PulleyParameters& p : pulleys) {
    const double rho = p.radius_ratio;
    const double per_rad =
        p.law == CapstanLaw::kClassic ? 1 : rho / (1 + rho) * std::pow(base_tension_N, p.exponent - 1);
    sum += p.alpha * per_rad * p.wrap_rad;
  }
  return sum;
}

double CapstanRatioAtZero(const PulleyParameters& pulley) {
  ValidatePulley(pulley);
  if (pulley.law == CapstanLaw::kClassic || pulley.exponent == 1 || pulley.alpha == 0) {
    return SolveCapstan(pulley, 1);  // the same ratio at every tension
  }
  return Finite(std::exp(LogRatioAtZero(pulley)));
}

double CapstanRatio(const PulleyParameters& pulley, double base_tension_N, bool release,
                    double low_tension_N) {
  if (!release) {
    if (low_tension_N > 0 && base_tension_N < low_tension_N)
      return SolveCapstan(pulley, low_tension_N) / low_tension_N;
    if (base_tension_N == 0) return CapstanRatioAtZero(pulley);
    return SolveCapstan(pulley, base_tension_N) / base_tension_N;
  }
  // While the motor pays out, the base has the higher tension.
  if (low_tension_N > 0) {
    const double high_of_low_N = SolveCapstan(pulley, low_tension_N);
    if (base_tension_N < high_of_low_N) return low_tension_N / high_of_low_N;
  }
  if (base_tension_N == 0) return 1 / CapstanRatioAtZero(pulley);
  return SolveCapstanInverse(pulley, base_tension_N) / base_tension_N;
}

double SolveCapstan(const PulleyParameters& pulley, double low_tension_N) {
  ValidatePulley(pulley);
  CheckTension("low-side", low_tension_N);
  if (low_tension_N == 0) return 0;
  const double log_low = std::log(low_tension_N);
  return Finite(low_tension_N * std::exp(SolveLog(pulley, log_low).log_high - log_low));
}

double SolveCapstanInverse(const PulleyParameters& pulley, double high_tension_N) {
  ValidatePulley(pulley);
  if (!(high_tension_N >= 0 && std::isfinite(high_tension_N))) CheckTension("high-side", high_tension_N);
  if (high_tension_N == 0) return 0;
  const double log_high = std::log(high_tension_N);
  return high_tension_N * std::exp(InvertLog(pulley, log_high) - log_high);
}

double SolveCapstan(std::span<const PulleyParameters> pulleys, double low_tension_N) {
  CheckTension("low-side", low_tension_N);
  for (const PulleyParameters& pulley : pulleys) low_tension_N = SolveCapstan(pulley, low_tension_N);
  return low_tension_N;
}

double SolveCapstanInverse(std::span<const PulleyParameters> pulleys, double high_tension_N) {
  CheckTension("high-side", high_tension_N);
  for (auto p = pulleys.rbegin(); p != pulleys.rend(); ++p)
    high_tension_N = SolveCapstanInverse(*p, high_tension_N);
  return high_tension_N;
}

}  // namespace tendril::model
