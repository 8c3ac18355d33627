// The page: a template filled with the report's JSON, a style sheet, a script and the plotting library. Knows
// nothing of the numbers' meaning; the script in the page draws them.
#include <fmt/format.h>

#include <stdexcept>
#include <utility>
#include <vector>

#include "report_page_files.h"
#include "tendril/config/whole_file.h"
#include "tendril/gap/report.h"

namespace tendril::gap {
namespace {

std::string EscapeHtml(std::string_view text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        out += c;
    }
  }
  return out;
}

// Inside a script element no text may close it or open a comment, so JSON escapes are used for these
// characters.
std::string EscapeForScript(std::string_view json) {
  std::string out;
  out.reserve(json.size());
  for (const char c : json) {
    switch (c) {
      case '<':
        out += "\\u003c";
        break;
      case '>':
        out += "\\u003e";
        break;
      case '&':
        out += "\\u0026";
        break;
      default:
        out += c;
    }
  }
  return out;
}

// The page needs no line ends and indentation of the JSON file.
std::string Compact(std::string_view json) {
  std::string out;
  out.reserve(json.size());
  for (std::size_t i = 0; i < json.size(); ++i) {
    out += json[i];
    if (json[i] != '\n') continue;
    out.pop_back();
    while (i + 1 < json.size() && json[i + 1] == ' ') ++i;
  }
  return out;
}

// Replaces every {{key}} of the template in one pass, without looking at inserted text again.
std::string Fill(std::string_view form, const std::vector<std::pair<std::string_view, std::string>>& texts) {
  std::string out;
  for (std::size_t at = 0;;) {
    const std::size_t open = form.find("{{", at);
    out += form.substr(at, open == std::string_view::npos ? open : open - at);
    if (open == std::string_view::npos) return out;
    const std::size_t close = form.find("}}", open);
    const std::string_view key = form.substr(open + 2, close - open - 2);
    for (const auto& [name, text] : texts) {
      if (name == key) out += text;
    }
    at = close + 2;
  }
}

// `d` as read back from `json`, so that both have the same valid text.
std::string Page(const Diagnosis& d, const std::string& json) {
  const std::string title =
      EscapeHtml(d.robot_name.empty() ? "Gap report" : fmt::format("Gap report: {}", d.robot_name));
  return Fill(page::kTemplate, {{"title", title},
                                {"sentence", EscapeHtml(d.sentence)},
                                {"style", std::string(page::kStyle)},
                                {"licence", EscapeHtml(page::kLicence)},
                                {"data", EscapeForScript(Compact(json))},
                                {"d3", std::string(page::kD3)},
                                {"script", std::string(page::kScript)}});
}

}  // namespace

std::string ReportStyle() { return std::string(page::kStyle); }

std::string ReportPage(const Diagnosis& diagnosis) {
  const std::string json = ReportJson(diagnosis);
  return Page(ParseReport(json), json);
}

void WriteReport(const Diagnosis& diagnosis, const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error || !std::filesystem::is_directory(folder)) {
    throw std::runtime_error(
        fmt::format("cannot make the folder {} for the report: {}", folder.string(), error.message()));
  }
  const std::string json = ReportJson(diagnosis);
  config::WriteWhole(folder / "report.json", json);
  config::WriteWhole(folder / "report.html", Page(ParseReport(json), json));
}

}  // namespace tendril::gap
