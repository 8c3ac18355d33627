// Tables of numbers, one row a case, and work on each row on all cores. Knows nothing of what the rows mean.
#pragma once

#include <nanobind/eigen/dense.h>
#include <nanobind/nanobind.h>

#include <Eigen/Core>
#include <algorithm>
#include <exception>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>

#include "interruptible.h"
#include "tendril/core/parallel.h"

namespace tendril::python {

using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// What went wrong in a row (from 0). In the package: tendril.RowError.
class RowError : public std::runtime_error {
 public:
  RowError(Eigen::Index at_row, const std::string& text) : std::runtime_error(text), row(at_row) {}
  Eigen::Index row;
};

/// Calls `work(row, scratch)` for each row on all cores, without the GIL; `make()` makes the scratch memory
/// of a thread. Both own what they use, because Ctrl-C may leave them behind. The result does not depend on
/// the number of threads; of several errors the first row's is thrown.
template <class Make, class Do>
void EachRow(Eigen::Index rows, Make make, Do work) {
  const auto from_to = [make = std::move(make), work = std::move(work)](Eigen::Index from, Eigen::Index to,
                                                                        const Work* all) {
    auto scratch = make();
    for (Eigen::Index i = from; i < to; ++i) {
      if (all && all->stopped()) throw Interrupted();
      work(i, scratch);
    }
  };
  if (rows <= 1) {
    const nanobind::gil_scoped_release released;
    from_to(0, rows, nullptr);
    return;
  }
  // Blocks, so that scratch memory is made seldom, and several a core, so that none waits long for the last.
  const Eigen::Index blocks = std::min<Eigen::Index>(rows, 8 * AllCores());
  const auto all = std::make_shared<Work>();
  const auto body = [=, work_of = all.get()] {
    ParallelFor(static_cast<int>(blocks), AllCores(),
                [&](int b) { from_to(rows * b / blocks, rows * (b + 1) / blocks, work_of); });
  };
  Run(all, body, nanobind::none());
}

}  // namespace tendril::python
