// Reads tests/model/golden/*.csv, which reference/make_goldens.py writes from another formulation of the
// mechanics.
#pragma once

#include <Eigen/Core>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace tendril::test {

class Golden {
 public:
  explicit Golden(const std::string& name) {
    std::ifstream file(std::string(TENDRIL_SOURCE_DIR) + "/tests/model/golden/" + name);
    if (!file) throw std::runtime_error("no golden " + name);
    std::string line, cell;
    std::getline(file, line);
    for (std::stringstream cells(line); std::getline(cells, cell, ',');) columns_.push_back(cell);
    while (std::getline(file, line)) {
      rows_.emplace_back();
      for (std::stringstream cells(line); std::getline(cells, cell, ',');)
        rows_.back().push_back(std::stod(cell));
      if (rows_.back().size() != columns_.size()) throw std::runtime_error("ragged golden " + name);
    }
  }

  std::size_t size() const { return rows_.size(); }
  /// `count` values of a row from the named column on.
  Eigen::VectorXd At(std::size_t row, const std::string& first, Eigen::Index count) const {
    std::size_t c = 0;
    while (c < columns_.size() && columns_[c] != first) ++c;
    if (c + static_cast<std::size_t>(count) > columns_.size())
      throw std::runtime_error("golden without " + first);
    return Eigen::Map<const Eigen::VectorXd>(rows_[row].data() + c, count);
  }

 private:
  std::vector<std::string> columns_;
  std::vector<std::vector<double>> rows_;
};

}  // namespace tendril::test
