// What can be asked of one signal, or of two, without knowing what it is. NaN: no value. Knows nothing of
// runs.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <utility>
#include <vector>

namespace tendril::gap {

using Signal = Eigen::Ref<const Eigen::VectorXd>;

/// Of the values that are there.
struct Range {
  double least = 0, most = 0;
  Eigen::Index count = 0;
  double width() const { return most - least; }
  /// Widest of the columns, as the range of that column.
  static Range Of(const Eigen::MatrixXd& columns);
};
Range RangeOf(const Signal& x);
/// Largest magnitude of what is there; 0 for nothing.
double Largest(const Eigen::MatrixXd& x);
double Quantile(std::vector<double> values, double q);
/// Range of what is there but for the rarest; 0 of hardly anything.
double UsualWidth(std::vector<double> values);
std::vector<Eigen::Index> FiniteRows(const Signal& x);
/// Rows from each value to the next.
std::vector<double> RowsApart(const Signal& x);
/// Rows of single values that stand out of the two before and the two after, by `least` or more and by far
/// more than nearly all others do: mishaps of a sensor whose signal is smooth. None where they are not rare.
std::vector<Eigen::Index> LoneValues(const Signal& x, double least);

/// Steps of increasing times.
struct TimeSteps {
  double usual = 0;   // median
  double jitter = 0;  // rms around it, of steps that are no gaps
  int gaps = 0;       // steps of more than 1.5 times the usual
  double lost = 0;    // rows that would fill them
};
TimeSteps StepsOf(const Eigen::VectorXd& time_s);

/// Share of values that are missing from the regular grid which the given rows suggest.
double LostOfOwnGrid(const std::vector<Eigen::Index>& rows);

/// True where values that come every so many rows slip against them: their rate is one of their own, and how
/// long a value waited for its row is open. `distances`: rows from value to value.
bool Slips(const std::vector<double>& distances);

/// Rms of the noise, from second differences of neighbours (their median, so that motion does not count).
double Scatter(const Signal& x);

/// How much of a scattering signal lies exactly still at its largest (least) value.
struct Plateau {
  double value = 0, share = 0;
};
Plateau FlatExtreme(const Signal& x, bool top);

/// Step of which all values are multiples; 0 when there is none.
double Quantum(const Signal& x);

/// Largest power of ten of which all values are multiples, as a table of few decimal places leaves them; 0
/// where there is none, or few different values.
double DecimalStep(const Signal& x);

/// Turning points between which the signal moves by more than 5 % of its range.
int Reversals(const Signal& x);

/// Lower and upper decile of the speed while it moves.
std::pair<double, double> Speeds(const Eigen::VectorXd& time_s, const Signal& x);

/// Correlation of changes over 0.1 s (or 3 samples): of each column of a with each of b; NaN where one does
/// not change.
Eigen::MatrixXd ChangeCorrelation(const Eigen::VectorXd& time_s, const Eigen::MatrixXd& a,
                                  const Eigen::MatrixXd& b);

/// Delay of `response` after `drive`, from the lag at which changes of the response are best a linear map of
/// changes of the drive; empty when there is no clear one.
struct Shift {
  double seconds = 0, correlation = 0;
};
std::optional<Shift> ClockShift(const Eigen::VectorXd& time_s, const Eigen::MatrixXd& drive,
                                const Eigen::MatrixXd& response);

/// Rms over all columns of x - y at x's times within y's; NaN when they have no common time.
double RmsDifference(const Eigen::VectorXd& x_time_s, const Eigen::MatrixXd& x,
                     const Eigen::VectorXd& y_time_s, const Eigen::MatrixXd& y);

}  // namespace tendril::gap
