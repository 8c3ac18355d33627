#include "qi2021.h"

#include <fmt/format.h>

#include <fstream>
#include <stdexcept>

#include "figures.h"
#include "tendril/core/version.h"

namespace tendril::qi2021 {
namespace {

using nlohmann::ordered_json;

const char* Text(Verdict v) {
  switch (v) {
    case Verdict::kConfirmed:
      return "confirmed";
    case Verdict::kDiffers:
      return "differs";
    case Verdict::kNotAsStated:
      return "not_reproducible_as_stated";
  }
  return "";
}

ordered_json ToJson(const JudgedClaim& judged) {
  const auto number = [](const std::optional<double>& x) { return x ? ordered_json(*x) : ordered_json(); };
  const auto& [c, f] = judged;
  return {{"id", c.id},
          {"section", c.section},
          {"figure", c.figure},
          {"what", c.what},
          {"claim", c.says},
          {"paper", c.paper},
          {"ours", f.ours},
          {"paper_value", number(c.paper_value)},
          {"our_value", number(f.our_value)},
          {"unit", c.unit},
          {"verdict", Text(f.verdict)},
          {"reason", f.reason},
          {"readings", f.readings},
          {"plot", c.plot}};
}

// Columns a text takes on a terminal: UTF-8 bytes that do not continue a character.
std::size_t Width(std::string_view text) {
  std::size_t n = 0;
  for (const char c : text) n += (static_cast<unsigned char>(c) & 0xC0) != 0x80;
  return n;
}

std::string Padded(std::string_view text, std::size_t width) {
  const std::size_t w = Width(text);
  return std::string(text) + std::string(w < width ? width - w : 1, ' ');
}

std::string Wrapped(const std::string& text, std::size_t indent, std::size_t width) {
  std::string lines;
  std::size_t column = 0;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find(' ', at), text.size());
    const std::string word = text.substr(at, end - at);
    if (column == 0 || column + 1 + Width(word) > width) {
      lines += fmt::format("{}{}{}", column == 0 ? "" : "\n", std::string(indent, ' '), word);
      column = indent + Width(word);
    } else {
      lines += " " + word;
      column += 1 + Width(word);
    }
    at = end + 1;
  }
  return lines + "\n";
}

}  // namespace

std::vector<JudgedClaim> Recompute(const std::filesystem::path& folder, ConfigFinder find,
                                   StageProgress progress) {
  Study study(folder, std::move(find), std::move(progress));
  CircleGeometry(study);
  ZeroTension(study);
  SingleTendon(study);
  PulleyCurves(study);
  PlanarBend(study);
  SpatialCircle(study);
  ConstantCurvature(study);
  study.End();
  return study.found();
}

void WriteJson(const std::filesystem::path& path, const std::vector<JudgedClaim>& claims, double wall_s) {
  ordered_json list = ordered_json::array();
  for (const JudgedClaim& c : claims) list.push_back(ToJson(c));
  const ordered_json all = {
      {"paper", "Qi et al., Dynamic of Cable-driven Continuum Robot with Nonlinear Friction Model, 2021"},
      {"version", Version()},
      {"git_revision", GitRevision()},
      {"wall_s", wall_s},
      {"claims", list}};
  std::ofstream out(path);
  out << all.dump(2) << '\n';
  if (!out.flush()) throw std::runtime_error("cannot write " + path.string());
}

std::string TableOf(const std::vector<JudgedClaim>& claims) {
  constexpr std::size_t kWidth = 118, kWhat = 44, kValue = 26;
  const auto line = [](std::string_view a, std::string_view b, std::string_view c, std::string_view d,
                       std::string_view e) {
    return fmt::format("{}{}{}{}{}\n", Padded(a, 9), Padded(b, kWhat), Padded(c, kValue), Padded(d, kValue),
                       e);
  };
  const std::string rule(kWidth, '-');
  std::string table = fmt::format("\n{}{}\n", line("", "claim", "paper", "ours", "verdict"), rule);
  int confirmed = 0, differs = 0, not_as_stated = 0;
  for (const auto& [c, f] : claims) {
    const std::string_view verdict = f.verdict == Verdict::kNotAsStated ? "not as stated" : Text(f.verdict);
    table += line(c.figure.empty() ? c.section : c.figure, c.what, c.paper, f.ours, verdict);
    table += Wrapped(f.reason, 9, kWidth);
    ++(f.verdict == Verdict::kConfirmed ? confirmed
       : f.verdict == Verdict::kDiffers ? differs
                                        : not_as_stated);
  }
  return table + fmt::format("{}\n{} claims: {} confirmed, {} differ, {} not reproducible as stated\n", rule,
                             claims.size(), confirmed, differs, not_as_stated);
}

}  // namespace tendril::qi2021
