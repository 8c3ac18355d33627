// Numbers independent of the locale; underflow is zero.
#include "cell.h"

#include <algorithm>
#include <array>
#include <charconv>

#include "text.h"

namespace tendril::gap {

bool MeansNone(std::string_view cell) {
  static constexpr std::array<std::string_view, 24> kWords{
      "nan", "-nan", "+nan", "na",      "n/a",      "null",      "none",     "-",
      "--",  "---",  "nil",  "missing", "nan(ind)", "-nan(ind)", "<na>",     "#n/a",
      "#na", "n.a.", "nat",  "1.#qnan", "1.#ind",   "-1.#ind",   "-1.#qnan", "undefined"};
  if (cell.empty()) return true;
  if (cell.size() > 9) return false;
  return std::find(kWords.begin(), kWords.end(), LowerCase(cell)) != kWords.end();
}

std::optional<double> CellNumber(std::string_view cell) {
  if (!cell.empty() && cell.front() == '+') cell.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), value);
  if (error == std::errc::result_out_of_range && end == cell.data() + cell.size()) {
    // Underflow is zero; overflow is an error.
    return cell.find("e-") != cell.npos || cell.find("E-") != cell.npos ? std::optional(0.0) : std::nullopt;
  }
  if (error != std::errc{} || end != cell.data() + cell.size()) return std::nullopt;
  return value;
}

}  // namespace tendril::gap
