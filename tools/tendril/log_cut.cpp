// tendril log cut: a part of a log as a log of its own. Knows the command line; the io room cuts.
#include "tendril/io/log_cut.h"

#include <fmt/format.h>

#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>

#include "commands.h"
#include "counted.h"
#include "number_option.h"
#include "progress.h"
#include "stop_signals.h"

namespace tendril::tools {
namespace {

namespace fs = std::filesystem;

struct CutOptions {
  std::string log, out;
  io::LogSpan span;
  bool overwrite = false;
};

void RefuseToLose(const CutOptions& o) {
  std::error_code ignored;
  if (fs::equivalent(o.log, o.out, ignored))
    throw UsageError("log cut: --out " + o.out + " is the log itself; give it another name");
  if (fs::exists(o.out, ignored) && !fs::is_regular_file(o.out, ignored))
    throw UsageError("log cut: --out " + o.out + " is a folder or a device; name a file");
  if (!o.overwrite && fs::exists(o.out, ignored))
    throw std::runtime_error(o.out + " exists; give another --out, or --overwrite to replace it");
}

void Cut(const CutOptions& o) {
  if (!o.span.from_s && !o.span.to_s)
    throw UsageError("log cut: nothing to cut off; give --from, --to or both");
  if (o.span.from_s && o.span.to_s && *o.span.from_s > *o.span.to_s)
    throw UsageError(fmt::format("log cut: --from {:g} is after --to {:g}", *o.span.from_s, *o.span.to_s));
  RefuseToLose(o);
  const std::atomic<bool>& stop = CatchStopSignals();
  io::CutResult result;
  {
    Progress progress;
    result = io::CutLog(o.log, o.span, o.out, [&](double share) {
      if (stop) throw std::runtime_error("log cut: ended by " + StoppedBy() + "; nothing is written");
      progress("cutting", share);
    });
  }
  fmt::print("{}: {} of {}, {:.3f} to {:.3f} s of {}\n", o.out, result.messages,
             Counted(result.of, "message"), result.from_s, result.to_s, o.log);
  if (!result.damage.empty())
    fmt::print(stderr, "tendril: log cut: {} is damaged: {}; the damage is left out\n", o.log, result.damage);
}

}  // namespace

void AddLogCutCommand(CLI::App& app) {
  auto o = std::make_shared<CutOptions>();
  CLI::App* cut = LogCommand(app).add_subcommand(
      "cut", "A part of a log as an LCM log of its own, with the robot and build that it is of");
  cut->add_option("LOG", o->log, "LCM log")->required();
  cut->add_option("--from", o->span.from_s, "begin of the part, since the begin of the log [s]")
      ->option_text("S")
      ->check(NumberFrom(0, 1e9, "give seconds since the begin of the log"));
  cut->add_option("--to", o->span.to_s, "end of the part, since the begin of the log [s]")
      ->option_text("S")
      ->check(NumberFrom(0, 1e9, "give seconds since the begin of the log"));
  cut->add_option("--out", o->out, "the new log")->required()->option_text("FILE");
  cut->add_flag("--overwrite", o->overwrite, "replace the new log where it exists");
  cut->footer(
      "Messages are copied as they are; the last RUN message before the part is put ahead of it. A part that "
      "begins in the middle cannot be replayed: the controller's memory is not in it.");
  cut->callback([o] { Cut(*o); });
}

}  // namespace tendril::tools
