// Questions about one signal or two, without knowing what they are. NaN: no value. Knows nothing of runs.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <utility>
#include <vector>

namespace tendril::gap {

using Signal = Eigen::Ref<const Eigen::VectorXd>;

/// Over the finite values.
struct Range {
  double least = 0, most = 0;
  Eigen::Index count = 0;
  double width() const { return most - least; }
  /// The column with the widest range, as that range.
  static Range Of(const Eigen::MatrixXd& columns);
};
Range RangeOf(const Signal& x);
/// Largest finite magnitude; 0 without values.
double Largest(const Eigen::MatrixXd& x);
double Quantile(std::vector<double> values, double q);
/// Range of the finite values except the rarest; 0 of too few values.
double UsualWidth(std::vector<double> values);
std::vector<Eigen::Index> FiniteRows(const Signal& x);
/// Number of rows from each value to the next.
std::vector<double> RowsApart(const Signal& x);
/// Rows of isolated values that deviate from the two before and the two after by at least `least`, and by far
/// more than nearly all others do: outliers of a sensor whose signal is smooth. Empty where they are not
/// rare.
std::vector<Eigen::Index> LoneValues(const Signal& x, double least);

/// Steps of increasing times.
struct TimeSteps {
  double usual = 0;   // median
  double jitter = 0;  // rms deviation from it, without gaps
  int gaps = 0;       // steps of more than 1.5 times the usual
  double lost = 0;    // number of rows missing in the gaps
};
TimeSteps StepsOf(const Eigen::VectorXd& time_s);

/// Share of values missing from the regular grid that the given rows suggest.
double LostOfOwnGrid(const std::vector<Eigen::Index>& rows);

/// True where values that come at regular distances slip against the rows: the sensor has a rate of its own,
/// and the age of a value in its row is unknown. `distances`: rows from value to value.
bool Slips(const std::vector<double>& distances);

/// Rms of the noise, from the median of second differences, so that motion does not count.
double Scatter(const Signal& x);

/// How much of a noisy signal lies exactly at its largest (least) value.
struct Plateau {
  double value = 0, share = 0;
};
Plateau FlatExtreme(const Signal& x, bool top);

/// The step of which all values are multiples; 0 when there is none.
double Quantum(const Signal& x);

/// Largest power of ten of which all values are multiples, as in a table with few decimal places; 0 where
/// there is none, or too few distinct values.
double DecimalStep(const Signal& x);

/// Turning points between which the signal moves by more than 5 % of its range.
int Reversals(const Signal& x);

/// Lower and upper decile of the speed while it moves.
std::pair<double, double> Speeds(const Eigen::VectorXd& time_s, const Signal& x);

/// Correlation of changes over 0.1 s (or 3 samples) between each column of a and each of b; NaN where one
/// does not change.
Eigen::MatrixXd ChangeCorrelation(const Eigen::VectorXd& time_s, const Eigen::MatrixXd& a,
                                  const Eigen::MatrixXd& b);

/// Delay of `response` after `drive`: the lag at which the response's changes are best predicted by a linear
/// map of the drive's; empty when there is no distinct one.
struct Shift {
  double seconds = 0, correlation = 0;
};
std::optional<Shift> ClockShift(const Eigen::VectorXd& time_s, const Eigen::MatrixXd& drive,
                                const Eigen::MatrixXd& response);

/// Rms over all columns of x - y at x's times within y's; NaN without a common time.
double RmsDifference(const Eigen::VectorXd& x_time_s, const Eigen::MatrixXd& x,
                     const Eigen::VectorXd& y_time_s, const Eigen::MatrixXd& y);

}  // namespace tendril::gap
