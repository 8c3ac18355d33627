// Lines of an XML file, indented as they are nested. Text comes from files whose rules allow no characters
// that XML would need to escape.
#pragma once

#include <fmt/format.h>

#include <Eigen/Core>
#include <string>
#include <utility>
#include <vector>

namespace tendril::exchange {

class Xml {
 public:
  template <class... Values>
  void Line(fmt::format_string<Values...> format, Values&&... values) {
    text_.append(2 * depth_, ' ')
        .append(fmt::format(format, std::forward<Values>(values)...))
        .push_back('\n');
  }
  /// A line that opens an element; what follows is within it.
  template <class... Values>
  void Open(fmt::format_string<Values...> format, Values&&... values) {
    Line(format, std::forward<Values>(values)...);
    ++depth_;
  }
  void Close(const char* element) {
    --depth_;
    Line("</{}>", element);
  }
  void Comment(const std::vector<std::string>& lines) {
    Line("<!--");
    for (std::string line : lines) {
      // XML allows no two dashes in a comment, names of robots do.
      for (std::size_t at; (at = line.find("--")) != line.npos;) line.insert(at + 1, 1, ' ');
      Line("  {}", line);
    }
    Line("-->");
  }
  std::string Text() && { return std::move(text_); }

 private:
  std::string text_;
  std::size_t depth_ = 0;
};

inline std::string Text(const Eigen::Vector3d& v) {
  return fmt::format("{:.10g} {:.10g} {:.10g}", v.x(), v.y(), v.z());
}

}  // namespace tendril::exchange
