// `tendril reproduce`: every claim of the paper that a simulation can check, the paper's value beside ours,
// with verdict and reason, as a table, JSON, series and one page. Knows no physics itself.
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstring>
#include <fstream>

#include "commands.h"
#include "output.h"
#include "study.h"
#include "tendril/core/version.h"

namespace tendril::tools {
namespace reproduce {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

double WallSeconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

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

ordered_json ToJson(const Claim& c) {
  const auto number = [](const std::optional<double>& x) { return x ? ordered_json(*x) : ordered_json(); };
  return {{"id", c.id},
          {"section", c.section},
          {"figure", c.figure},
          {"what", c.what},
          {"claim", c.says},
          {"paper", c.paper},
          {"ours", c.ours},
          {"paper_value", number(c.paper_value)},
          {"our_value", number(c.our_value)},
          {"unit", c.unit},
          {"verdict", Text(c.verdict)},
          {"reason", c.reason},
          {"readings", c.readings},
          {"plot", c.plot}};
}

void WriteJson(const fs::path& path, const std::vector<Claim>& claims, double wall_s) {
  ordered_json list = ordered_json::array();
  for (const Claim& c : claims) list.push_back(ToJson(c));
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

// Columns a text takes on a terminal: UTF-8 bytes that do not continue a character.
std::size_t Width(std::string_view text) {
  std::size_t n = 0;
  for (const char c : text) n += (static_cast<unsigned char>(c) & 0xC0) != 0x80;
  return n;
}

std::string Padded(std::string text, std::size_t width) {
  const std::size_t w = Width(text);
  return text + std::string(w < width ? width - w : 1, ' ');
}

void PrintWrapped(const std::string& text, std::size_t indent, std::size_t width) {
  std::size_t column = 0;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find(' ', at), text.size());
    const std::string word = text.substr(at, end - at);
    if (column == 0 || column + 1 + Width(word) > width) {
      fmt::print("{}{}{}", column == 0 ? "" : "\n", std::string(indent, ' '), word);
      column = indent + Width(word);
    } else {
      fmt::print(" {}", word);
      column += 1 + Width(word);
    }
    at = end + 1;
  }
  fmt::print("\n");
}

void PrintTable(const std::vector<Claim>& claims) {
  constexpr std::size_t kWidth = 118, kWhat = 44, kValue = 26;
  const auto line = [](const std::string& a, const std::string& b, const std::string& c, const std::string& d,
                       const std::string& e) {
    fmt::print("{}{}{}{}{}\n", Padded(a, 9), Padded(b, kWhat), Padded(c, kValue), Padded(d, kValue), e);
  };
  fmt::print("\n");
  line("", "claim", "paper", "ours", "verdict");
  fmt::print("{}\n", std::string(kWidth, '-'));
  int confirmed = 0, differs = 0, not_as_stated = 0;
  for (const Claim& c : claims) {
    std::string verdict = Text(c.verdict);
    if (c.verdict == Verdict::kNotAsStated) verdict = "not as stated";
    line(c.figure.empty() ? c.section : c.figure, c.what, c.paper, c.ours, verdict);
    PrintWrapped(c.reason, 9, kWidth);
    ++(c.verdict == Verdict::kConfirmed ? confirmed
       : c.verdict == Verdict::kDiffers ? differs
                                        : not_as_stated);
  }
  fmt::print("{}\n{} claims: {} confirmed, {} differ, {} not reproducible as stated\n",
             std::string(kWidth, '-'), claims.size(), confirmed, differs, not_as_stated);
}

struct Options {
  std::string out = "tendril-reproduce";
  bool plots = true;
};

void Run(const Options& options) {
  const fs::path folder = MakeOutputFolder(options.out);
  const double start_s = WallSeconds();
  Study study(folder);
  CircleGeometry(study);
  ZeroTension(study);
  SingleTendon(study);
  PulleyCurves(study);
  PlanarBend(study);
  SpatialCircle(study);
  ConstantCurvature(study);
  const std::vector<Claim>& claims = study.Finish();
  WriteJson(folder / "reproduce.json", claims, WallSeconds() - start_s);
  PrintTable(claims);
  if (options.plots) RunPlotScript("report_reproduce.py", {folder}, "the page");
  fmt::print("  {}\n    {}reproduce.json and the series (*.csv)\n",
             fs::absolute(folder).lexically_normal().string(), options.plots ? "index.html, " : "");
}

}  // namespace

Series::Series(const fs::path& path, const std::vector<std::string>& columns)
    : file_([&] {
        std::FILE* f = std::fopen(path.c_str(), "w");
        if (!f)
          throw std::runtime_error(fmt::format("cannot write {}: {}", path.string(), std::strerror(errno)));
        return f;
      }()),
      writer_(file_.get(), columns) {}

Study::Study(fs::path folder)
    : folder_(std::move(folder)), start_s_(WallSeconds()), terminal_(isatty(STDERR_FILENO)) {}

void Study::Begin(const std::string& stage) {
  if (!stage_.empty()) Show(true);
  stage_ = stage;
  percent_ = 0;
  stage_start_s_ = WallSeconds();
  if (terminal_) Show(false);
}

void Study::Progress(double share) {
  const int percent = static_cast<int>(100 * share);
  if (!terminal_ || percent <= percent_) return;
  percent_ = percent;
  Show(false);
}

void Study::Show(bool last) {
  const double now_s = WallSeconds();
  fmt::print(stderr, "{}  {:<62} {:>3} %  {:5.1f} s  (in all {:5.1f} s){}", terminal_ ? "\r" : "", stage_,
             last ? 100 : percent_, now_s - stage_start_s_, now_s - start_s_, last ? "\n" : "");
}

const std::vector<Claim>& Study::Finish() {
  Show(true);
  return claims_;
}

double Apart(double ours, double paper) { return std::abs(ours - paper) / std::abs(paper); }

}  // namespace reproduce

void AddReproduceCommand(CLI::App& app) {
  auto options = std::make_shared<reproduce::Options>();
  CLI::App* command = app.add_subcommand(
      "reproduce", "The paper's claims and figures recomputed: its values beside ours, verdict and reason");
  command->add_option("--out", options->out, "folder for index.html, reproduce.json and the series")
      ->capture_default_str();
  command->add_flag("!--no-plots", options->plots, "leave out the plots and the page");
  command->callback([options] { reproduce::Run(*options); });
}

}  // namespace tendril::tools
