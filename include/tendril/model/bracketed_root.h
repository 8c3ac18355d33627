// Root of a function of one variable between two points of opposite sign. Safe in the tick: bounded steps.
#pragma once

#include <cmath>

namespace tendril::model {

/// Secant steps that keep the bracket (Illinois), until |f| or the bracket is within `tolerance` or `steps`
/// are done. `at_a` and `at_b` are f at both ends, of opposite sign.
template <class Function>
double BracketedRoot(const Function& f, double a, double at_a, double b, double at_b, double tolerance,
                     int steps) {
  int side = 0;
  double x = b;
  for (int i = 0; i < steps && std::abs(b - a) > tolerance; ++i) {
    x = (a * at_b - b * at_a) / (at_b - at_a);
    const double at = f(x);
    if (std::abs(at) <= tolerance) break;
    // The weight of an end that stays is halved, so that both ends converge.
    if (at * at_b > 0) {
      b = x;
      at_b = at;
      if (side == 1) at_a *= 0.5;
      side = 1;
    } else {
      a = x;
      at_a = at;
      if (side == -1) at_b *= 0.5;
      side = -1;
    }
  }
  return x;
}

}  // namespace tendril::model
