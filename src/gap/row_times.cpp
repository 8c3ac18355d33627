// Which rows of a table follow each other in time; see the header.
#include "row_times.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "median.h"

namespace tendril::gap {
namespace {

/// Rows [begin, end) of the longest part of a table whose clock restarted: time jumps back and continues for
/// long without reaching its previous value.
std::pair<std::size_t, std::size_t> LongestOfOneClock(const std::vector<double>& t,
                                                      const std::vector<int>& lines, Run& run) {
  constexpr std::size_t kLong = 50;
  std::pair<std::size_t, std::size_t> longest{0, 0};
  std::size_t begin = 0, restarts = 0;
  int first_line = 0;
  const auto part_ends = [&](std::size_t end) {
    if (end - begin > longest.second - longest.first) longest = {begin, end};
    begin = end;
  };
  for (std::size_t i = 2; i + kLong <= t.size(); ++i) {
    // A single row that jumps ahead is also followed by a jump back.
    const double before = std::min(t[i - 2], t[i - 1]);
    bool restarted = t[i] < before && t[i + kLong - 1] < before;
    for (std::size_t k = i + 1; k < i + kLong && restarted; ++k) restarted = t[k] > t[k - 1];
    if (!restarted) continue;
    if (restarts++ == 0) first_line = lines[i];
    part_ends(i);
  }
  part_ends(t.size());
  if (restarts > 0) {
    run.warnings.push_back(fmt::format(
        "the clock restarts {} time{}, first in line {}: the longest part is read, {} of {} rows; split the "
        "file there to use the others",
        restarts, restarts == 1 ? "" : "s", first_line, longest.second - longest.first, t.size()));
  }
  return longest;
}

/// Spreads rows with equal stamps, from a clock coarser than the log: evenly from its tick to the next. After
/// the beginning and after a pause, where rows of a tick may be missing, they end at the next tick; before
/// the end and before a pause they begin at their own.
void SpreadStamps(std::vector<double>& t, const SameRow& same, Run& run) {
  constexpr double kMany = 0.2;     // of the rows: fewer are duplicates
  constexpr double kPause = 1.5;    // in usual ticks
  std::vector<std::size_t> begins;  // first row of each stamp
  bool others = false;
  for (std::size_t i = 0; i < t.size(); ++i) {
    if (i == 0 || t[i] != t[i - 1])
      begins.push_back(i);
    else
      others = others || !same(i, i - 1);
  }
  const std::size_t stamps = begins.size(), shared = t.size() - stamps;
  if (!others || stamps < 3 || static_cast<double>(shared) < kMany * static_cast<double>(t.size())) return;
  begins.push_back(t.size());
  const std::vector<double> stamp = t;
  std::vector<double> ticks_s, steps_s;
  for (std::size_t k = 1; k + 1 < stamps; ++k) {
    const double tick_s = stamp[begins[k + 1]] - stamp[begins[k]];
    if (!(tick_s > 0)) continue;
    ticks_s.push_back(tick_s);
    steps_s.push_back(tick_s / static_cast<double>(begins[k + 1] - begins[k]));
  }
  if (ticks_s.empty()) return;
  const double usual_s = Median(std::move(ticks_s)), step_s = Median(std::move(steps_s));
  const auto goes_on = [&](std::size_t k) {  // from stamp k - 1 to stamp k
    const double tick_s = k > 0 && k < stamps ? stamp[begins[k]] - stamp[begins[k - 1]] : 0;
    return tick_s > 0 && tick_s < kPause * usual_s;
  };
  for (std::size_t k = 0; k < stamps; ++k) {
    const std::size_t begin = begins[k], count = begins[k + 1] - begin;
    const auto rows = static_cast<double>(count);
    double from_s = stamp[begin], each_s = step_s;
    if (goes_on(k + 1)) {
      const double next_s = stamp[begins[k + 1]];
      if (goes_on(k))
        each_s = (next_s - from_s) / rows;
      else
        from_s = next_s - rows * step_s;
    }
    for (std::size_t i = 0; i < count; ++i) t[begin + i] = from_s + static_cast<double>(i) * each_s;
  }
  run.warnings.push_back(fmt::format(
      "{} of {} rows have the stamp of the row before, of a clock that ticks every {:.3g} s: spread evenly "
      "between the ticks; fast effects (delay, damping) are blurred; stamp rows where they are taken",
      shared, t.size(), usual_s));
}

}  // namespace

SameRow SameNumbers(const Table& table, std::size_t from) {
  return [&table, from](std::size_t a, std::size_t b) {
    return std::all_of(table.numbers.begin(), table.numbers.end(), [&](const std::vector<double>& column) {
      if (column.empty()) return true;
      const double x = column[from + a], y = column[from + b];
      return x == y || (std::isnan(x) && std::isnan(y));
    });
  };
}

// Rows after a clock restart belong to another run. A single row that jumps ahead of the next two is itself
// wrong.
std::vector<int> RowsInTime(std::vector<double>& t, const std::vector<int>& lines, const SameRow& same,
                            Run& run) {
  SpreadStamps(t, same, run);
  const auto [begin, end] = LongestOfOneClock(t, lines, run);
  std::vector<int> rows;
  rows.reserve(t.size());
  const auto later = [&](std::size_t i, std::size_t than) { return t[i] > t[than]; };
  std::size_t without = 0, back = 0, earlier = 0;
  int first_back = 0;
  for (std::size_t i = begin; i < end; ++i) {
    if (!std::isfinite(t[i])) {
      ++without;
      continue;
    }
    const auto last = rows.empty() ? t.size() : static_cast<std::size_t>(rows.back());
    const bool jumped = i + 2 < end && !later(i + 1, i) && !later(i + 2, i) && later(i + 2, i + 1) &&
                        (rows.empty() || later(i + 1, last));
    if (jumped || (!rows.empty() && !later(i, last))) {
      if (back++ == 0) first_back = lines[i];
      if (!rows.empty() && later(last, i)) ++earlier;
      continue;
    }
    rows.push_back(static_cast<int>(i));
  }
  if (without > 0) run.warnings.push_back(fmt::format("{} rows without a time dropped", without));
  // More rows that go back than rows that go on: what goes on is chance, and no run.
  if (earlier > rows.size()) {
    run.warnings.push_back(
        fmt::format("the rows are not in the order of their times, the first that goes back in line {}; sort "
                    "the table by its time",
                    first_back));
    return {};
  }
  if (back > 0) {
    run.warnings.push_back(
        fmt::format("{} rows whose time does not increase dropped, the first in line {}; if the clock "
                    "restarted there, split "
                    "the file",
                    back, first_back));
  }
  return rows;
}

void NoteGaps(Run& run) {
  const Eigen::Index rows = run.time_s.size();
  if (rows < 3) return;
  std::vector<double> steps(static_cast<std::size_t>(rows - 1));
  for (Eigen::Index i = 0; i + 1 < rows; ++i) {
    steps[static_cast<std::size_t>(i)] = run.time_s[i + 1] - run.time_s[i];
  }
  const double usual = Median(steps);
  int gaps = 0;
  double longest = 0, where = 0, lost = 0;
  for (std::size_t i = 0; i < steps.size(); ++i) {
    if (steps[i] <= 1.5 * usual) continue;
    ++gaps;
    lost += std::round(steps[i] / usual) - 1;
    if (steps[i] > longest) {
      longest = steps[i];
      where = run.time_s[static_cast<Eigen::Index>(i)];
    }
  }
  // A log with irregular times has no grid in which rows could be missing.
  if (gaps == 0 || gaps > rows / 5) return;
  run.notes.push_back(
      fmt::format("{} gaps in the time grid of {:.6g} s ({:.0f} rows missing), the longest {:.6g} s "
                  "at t = {:.6g} s",
                  gaps, usual, lost, longest, where));
}

}  // namespace tendril::gap
