// The terminal's summary of a diagnosis: the page's first screen in a few lines of text. Knows nothing of the
// terminal itself.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <sstream>
#include <vector>

#include "parameters_by_deviation.h"
#include "tendril/gap/report.h"
#include "tendril/gap/words.h"

namespace tendril::gap {
namespace {

constexpr int kWidth = 100;

// Characters, not bytes, of a UTF-8 text.
int Width(std::string_view text) {
  return static_cast<int>(std::count_if(
      text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0) != 0x80; }));
}

std::string Cut(std::string_view text, int width) {
  if (Width(text) <= width) return std::string(text);
  std::string out;
  int letters = 0;
  for (const char c : text) {
    if ((static_cast<unsigned char>(c) & 0xC0) != 0x80 && ++letters > width - 3) break;
    out += c;
  }
  return out + "...";
}

std::string Pad(std::string_view text, int width) {
  std::string out = Cut(text, width);
  return out + std::string(static_cast<std::size_t>(std::max(0, width - Width(out))), ' ');
}

// Control characters in a name must not reach the terminal.
std::string Clean(std::string_view text) {
  std::string out(text);
  for (char& c : out) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
  }
  return out;
}

std::string Bar(double share, int width) {
  const auto full =
      static_cast<std::size_t>(std::lround(std::clamp(std::isfinite(share) ? share : 0, 0.0, 1.0) * width));
  return std::string(full, '#') + std::string(static_cast<std::size_t>(width) - full, '.');
}

class Paint {
 public:
  explicit Paint(bool colour) : colour_(colour) {}
  std::string operator()(const char* code, const std::string& text) const {
    return colour_ ? fmt::format("\x1b[{}m{}\x1b[0m", code, text) : text;
  }

 private:
  bool colour_;
};

constexpr const char *kBold = "1", *kRed = "1;31", *kGreen = "32", *kYellow = "33", *kDim = "2";

// "1, 3 to 6".
std::string Ranges(const std::vector<std::string>& numbers) {
  std::string text;
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    std::size_t last = i;
    const auto follows = [&](std::size_t next) {
      return next < numbers.size() &&
             numbers[next] == std::to_string(std::atoi(numbers[next - 1].c_str()) + 1);
    };
    while (follows(last + 1)) ++last;
    text += (text.empty() ? "" : ", ") + numbers[i];
    if (last - i >= 2) text += " to " + numbers[i = last];
  }
  return text;
}

// "tendons 1, 3 to 6, section 1" for tendon:1, tendon:3, ..., section:1.
std::string PlacesText(const std::vector<std::string>& places) {
  std::vector<std::pair<std::string, std::vector<std::string>>> kinds;  // and their numbers
  for (const std::string& place : places) {
    const auto colon = place.find(':');
    const std::string kind = place.substr(0, colon);
    if (kinds.empty() || kinds.back().first != kind) kinds.push_back({kind, {}});
    if (colon != place.npos) kinds.back().second.push_back(place.substr(colon + 1));
  }
  std::string text;
  for (const auto& [kind, numbers] : kinds) {
    text += (text.empty() ? "" : ", ") + kind + (numbers.size() > 1 ? "s" : "");
    if (!numbers.empty()) text += " " + Ranges(numbers);
  }
  return text;
}

// Each of `parts` whole, on as many lines as they need from a column of the first line on.
std::string InColumn(const std::vector<std::string>& parts, int column) {
  std::string out, line;
  for (const std::string& whole : parts) {
    const std::string part = Cut(whole, kWidth - column);
    if (!line.empty() && column + Width(line) + 2 + Width(part) > kWidth) {
      out += line + ",\n" + std::string(static_cast<std::size_t>(column), ' ');
      line.clear();
    }
    line += (line.empty() ? "" : ", ") + part;
  }
  return out + line;
}

std::string ChainLine(sim::Cut cut, const Diagnosis& d, const Paint& paint) {
  const CutFinding* worst = nullptr;
  bool listed = false, first = false;
  std::vector<std::string> places;
  for (const CutFinding& f : d.location) {
    if (f.cut != cut) continue;
    listed = true;
    if (!f.measured) continue;
    first |= f.first;
    if (!worst || std::pair(f.excess, f.excess_sigma) > std::pair(worst->excess, worst->excess_sigma))
      worst = &f;
    if (f.excess && f.where != "all" && std::find(places.begin(), places.end(), f.where) == places.end())
      places.push_back(f.where);
  }
  const CutText& text = TextOf(cut);
  const std::string head = fmt::format("  {} {} {} ", sim::CutName(cut), Pad(text.title, 13),
                                       Pad(fmt::format("{} -> {}", text.from, text.to), 30));
  if (!worst) return head + paint(kDim, listed ? "not covered by these logs" : "not measured") + "\n";
  if (worst->uncertain())
    return head +
           paint(kYellow, fmt::format("{:>6} sigma  in too few seconds", Sigmas(worst->excess_sigma))) + "\n";
  if (!worst->excess) return head + paint(kGreen, "at the noise floor") + "\n";
  // Existing stamps may be exact where others are lost.
  const std::string state =
      worst->excess_sigma > 0
          ? fmt::format("{:>6} sigma  {} rms", Sigmas(worst->excess_sigma), WithUnit(worst->rms, worst->unit))
          : Clean(worst->note);
  const std::string mark = first ? "  <- starts here" : "";
  const int rest = kWidth - Width(head) - Width(state) - Width(mark) - 2;
  std::string line = head + paint(first ? kRed : kYellow, state);
  if (!places.empty() && rest > 8) line += "  " + Cut(Clean(PlacesText(places)), rest);
  return line + paint(kRed, mark) + "\n";
}

std::string CauseLine(const Cause& c, const Paint& paint, bool accepted) {
  std::string name = c.effect == "no_gap"    ? "no gap"
                     : c.effect == "unknown" ? "unknown (not in the library)"
                                             : c.effect;
  if (!c.where.empty() && c.where != "all") name += " " + c.where;
  std::vector<std::string> parameters;
  for (const auto& [key, e] : ParametersByDeviation(c))
    parameters.push_back(Clean(ParameterWords(key, e, true)));
  if (c.bound_hit) parameters.emplace_back("at a bound");
  const std::string head = fmt::format("  {} {} {:>5}", Pad(Clean(name), 30), Bar(c.p, 20), Percent(c.p));
  return (accepted ? paint(kBold, head) : head) +
         (parameters.empty() ? "" : "  " + InColumn(parameters, Width(head) + 2)) + "\n";
}

/// What the causes do to the simulator that sees commands only, over all kinds of motion.
std::string FreeRunLine(const std::vector<FreeRun>& free_runs) {
  double before = 0, after = 0, moves = 0;
  for (const FreeRun& f : free_runs) {
    const double n = static_cast<double>(free_runs.size());
    before += f.before_m * f.before_m / n;
    after += std::pow(f.after_m.value_or(std::numeric_limits<double>::quiet_NaN()), 2) / n;
    moves += f.moves_m * f.moves_m / n;
  }
  if (free_runs.empty() || !std::isfinite(after)) return "";
  return fmt::format("  {} {} -> {}  (moves {})\n", Pad("tip, free run of the simulator", 36),
                     WithUnit(std::sqrt(before), "m"), WithUnit(std::sqrt(after), "m"),
                     WithUnit(std::sqrt(moves), "m"));
}

}  // namespace

std::string Wrapped(std::string_view text, int indent) {
  std::istringstream words(Clean(text));
  const std::string margin(static_cast<std::size_t>(indent), ' ');
  std::string out, line;
  for (std::string word; words >> word;) {
    if (!line.empty() && indent + Width(line) + 1 + Width(word) > kWidth) {
      out += margin + line + "\n";
      line.clear();
    }
    line += (line.empty() ? "" : " ") + word;
  }
  return out + margin + line + "\n";
}

std::string Summary(const Diagnosis& diagnosis, const std::filesystem::path& report, bool colour) {
  const Diagnosis d = Condensed(diagnosis);
  const Paint paint(colour);
  std::string out = fmt::format("\n{}\nWhere\n", paint(kBold, Wrapped(d.sentence, 0)));
  for (int i = 0; i < sim::kCuts; ++i) out += ChainLine(static_cast<sim::Cut>(i), d, paint);

  out += "\nCauses\n";
  constexpr std::size_t kShown = 5;
  for (std::size_t i = 0; i < d.causes.size(); ++i) {
    const Cause& c = d.causes[i];
    const bool accepted = std::any_of(d.accepted.begin(), d.accepted.end(), [&](const Cause& a) {
      return a.effect == c.effect && a.where == c.where;
    });
    if (i < kShown || accepted || c.effect == "no_gap" || c.effect == "unknown")
      out += CauseLine(c, paint, accepted);
  }
  if (d.verdict == Verdict::kAmbiguousGroup) {
    std::string members;
    for (const Cause& c : d.causes) {
      if (c.group > 0 && c.group == d.causes.front().group)
        members += (members.empty() ? "" : ", ") + c.effect + (c.where.empty() ? "" : " " + c.where);
    }
    if (!members.empty()) out += Wrapped("These runs cannot tell apart: " + members, 2);
  }

  if (d.closed) {
    const auto bound = [](double share) { return share < -1 ? "below -100 %" : Percent(share); };
    out += fmt::format("\nClosed {} of the gap on held-out {} (95 %: {} to {})\n", Percent(d.closed->value),
                       d.held_out_by, bound(d.closed->low), bound(d.closed->high));
    // The channels with the largest gap.
    std::vector<const Closure*> rows;
    for (const Closure& c : d.closures) {
      if (c.closed) rows.push_back(&c);
    }
    const auto size = [](const Closure* c) { return c->before_rms / std::max(c->floor_rms, 1e-300); };
    std::stable_sort(rows.begin(), rows.end(),
                     [&](const Closure* a, const Closure* b) { return size(a) > size(b); });
    for (std::size_t i = 0; i < std::min<std::size_t>(rows.size(), 4); ++i) {
      const Closure& c = *rows[i];
      out += fmt::format("  {} {} -> {}  (floor {})\n", Pad(Clean(c.channel), 36),
                         WithUnit(c.before_rms, c.unit), WithUnit(c.after_rms, c.unit),
                         WithUnit(c.floor_rms, c.unit));
    }
    out += FreeRunLine(d.free_runs);
  }

  if (!d.next.family.empty() || !d.next.reason.empty()) {
    const std::string family = d.next.family.empty() ? "" : ": " + paint(kBold, Clean(d.next.family));
    out += fmt::format("\nNext{}\n{}", family, d.next.reason.empty() ? "" : Wrapped(d.next.reason, 2));
  }
  // Not wrapped, so that they can be copied.
  for (std::size_t i = 0; i < d.next_commands.size(); ++i)
    out += fmt::format("{}  {}\n", i == 0 ? "\nTo run next\n" : "", paint(kBold, Clean(d.next_commands[i])));
  if (!d.degradations.empty()) {
    constexpr std::size_t kTold = 5;
    out += "\nLimits of these logs\n";
    for (std::size_t i = 0; i < std::min(kTold, d.degradations.size()); ++i)
      out += Wrapped(Clean(d.degradations[i]), 2);
    if (d.degradations.size() > kTold)
      out += fmt::format("  and {} more in the report\n", d.degradations.size() - kTold);
  }
  const auto troubles = std::count_if(d.health.begin(), d.health.end(), [](const HealthFinding& h) {
    return h.severity != HealthFinding::Severity::kInfo;
  });
  if (troubles > 0) {
    out += fmt::format("\nData\n");
    std::size_t shown = 0;
    for (const HealthFinding& h : d.health) {
      if (h.severity == HealthFinding::Severity::kInfo || shown++ >= 3) continue;
      std::string at = h.run + (h.run.empty() || h.channel.empty() ? "" : ", ") + h.channel;
      out += Wrapped((at.empty() ? "" : at + ": ") + h.text, 2);
    }
    if (troubles > 3) out += fmt::format("  and {} more warnings in the report\n", troubles - 3);
  }
  if (!report.empty()) out += fmt::format("\nReport: {}\n", report.string());
  return out;
}

}  // namespace tendril::gap
