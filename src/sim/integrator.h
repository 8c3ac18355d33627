// CVODE (BDF) behind a small interface: one accepted step at a time, own Newton matrix, restart after a
// failed step. Knows nothing of robots.
#pragma once

#include <cvode/cvode.h>
#include <nvector/nvector_serial.h>

#include <Eigen/Core>
#include <string>

namespace tendril::sim {

/// y' = f(t, y), and a solver for (I - gamma df/dy) x = b at the point where f was evaluated last.
class OdeSystem {
 public:
  virtual ~OdeSystem() = default;
  /// False: y is outside the domain; the step is shortened.
  virtual bool Derivative(double t, const double* y, double* derivative) noexcept = 0;
  virtual bool SolveNewton(double gamma, const double* b, double* x) noexcept = 0;
};

class Integrator {
 public:
  struct Tolerances {
    double relative;
    Eigen::VectorXd absolute;  // per state
  };
  /// Formulas of order 3 to 5 are not stable for vibrations that are hardly damped and far faster than a
  /// step, as those along a rod: `vibrates` lets CVODE detect that and lower the order.
  Integrator(OdeSystem& system, const Eigen::VectorXd& y0, const Tolerances& tolerances, double longest_step,
             bool vibrates = false);
  ~Integrator();
  Integrator(const Integrator&) = delete;
  Integrator& operator=(const Integrator&) = delete;

  /// One accepted step, not past `end`; the steps to `end` are made about equally long. A step that CVODE
  /// gives up is retried from the last accepted point as a fresh start with a first step of 1 us, then 10 ns,
  /// then 0.1 ns; after that std::runtime_error with CVODE's reason.
  void StepTowards(double end);

  double t() const noexcept { return t_; }
  const Eigen::VectorXd& y() const noexcept { return y_; }

  struct Counters {
    long steps = 0, derivatives = 0, newton = 0, error_test_failures = 0, convergence_failures = 0,
         restarts = 0;
  };
  Counters counters() const;

 private:
  double NextStep(bool stopped);
  void Restart(double first_step);
  Counters SolverCounters() const;

  OdeSystem& system_;
  Tolerances tolerances_;
  double t_ = 0;
  Eigen::VectorXd y_;
  SUNContext context_ = nullptr;
  N_Vector vector_ = nullptr, error_ = nullptr, weights_ = nullptr;
  SUNLinearSolver linear_ = nullptr;
  void* cvode_ = nullptr;
  double next_step_ = 0;  // 0: not known yet
  std::string reason_;    // CVODE's last message
  Counters before_restart_;

  friend struct IntegratorCallbacks;
};

}  // namespace tendril::sim
