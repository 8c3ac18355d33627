// `tendril reproduce`: runs the study of the paper and shows its progress. Knows no physics.
#include <fmt/format.h>
#include <unistd.h>

#include <chrono>

#include "commands.h"
#include "output.h"
#include "paths.h"
#include "qi2021/qi2021.h"

namespace tendril::tools {
namespace {

namespace fs = std::filesystem;

struct ReproduceOptions {
  std::string out = "tendril-reproduce";
  bool plots = true;
};

/// One line a stage; on a terminal it moves.
class StageLines {
 public:
  void Show(const std::string& stage, double share, bool ended) {
    if (stage != stage_) {
      stage_ = stage;
      stage_start_s_ = Seconds();
      percent_ = -1;
    }
    const int percent = ended ? 100 : static_cast<int>(100 * share);
    if (!ended && (!terminal_ || percent <= percent_)) return;
    percent_ = percent;
    fmt::print(stderr, "{}  {:<62} {:>3} %  {:5.1f} s  (in all {:5.1f} s){}", terminal_ ? "\r" : "", stage_,
               percent, Seconds() - stage_start_s_, Seconds(), ended ? "\n" : "");
  }
  double Seconds() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  const bool terminal_ = isatty(STDERR_FILENO);
  std::string stage_;
  double stage_start_s_ = 0;
  int percent_ = -1;
};

void RunReproduce(const ReproduceOptions& options) {
  const fs::path folder = MakeOutputFolder(options.out);
  StageLines lines;
  const auto claims = qi2021::Recompute(
      folder, ConfigFile,
      [&](const std::string& stage, double share, bool ended) { lines.Show(stage, share, ended); });
  qi2021::WriteJson(folder / "reproduce.json", claims, lines.Seconds());
  fmt::print("{}", qi2021::TableOf(claims));
  if (options.plots) RunPlotScript("report_reproduce.py", {folder}, "the page");
  fmt::print("  {}\n    {}reproduce.json and the series (*.csv)\n",
             fs::absolute(folder).lexically_normal().string(), options.plots ? "index.html, " : "");
}

}  // namespace

void AddReproduceCommand(CLI::App& app) {
  auto options = std::make_shared<ReproduceOptions>();
  CLI::App* command = app.add_subcommand(
      "reproduce", "The paper's claims and figures recomputed: its values beside ours, verdict and reason");
  command->add_option("--out", options->out, "folder for index.html, reproduce.json and the series")
      ->capture_default_str();
  command->add_flag("!--no-plots", options->plots, "leave out the plots and the page");
  command->callback([options] { RunReproduce(*options); });
}

}  // namespace tendril::tools
