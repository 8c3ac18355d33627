#include "tendril/gap/health_lines.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <map>

namespace tendril::gap {
namespace {

using Severity = HealthFinding::Severity;

/// Findings of several runs that differ in their numbers only.
struct Group {
  const HealthFinding* first;
  std::size_t others;
};

std::string KindOf(const HealthFinding& f) {
  std::string kind = fmt::format("{} {} ", static_cast<int>(f.severity), f.channel);
  for (const char c : f.text) {
    if (!std::isdigit(static_cast<unsigned char>(c))) kind += c;
  }
  return kind;
}

std::vector<Group> Grouped(const std::vector<HealthFinding>& findings) {
  std::vector<Group> groups;
  std::map<std::string, std::size_t> known;
  for (const HealthFinding& f : findings) {
    if (f.severity == Severity::kInfo && f.channel != "file") continue;
    const auto [at, is_first] = known.emplace(KindOf(f), groups.size());
    if (is_first) {
      groups.push_back({&f, 0});
    } else {
      ++groups[at->second].others;
    }
  }
  std::stable_sort(groups.begin(), groups.end(),
                   [](const Group& a, const Group& b) { return a.first->severity > b.first->severity; });
  return groups;
}

}  // namespace

std::vector<std::string> FindingLines(const std::vector<HealthFinding>& findings, std::size_t most) {
  const std::vector<Group> groups = Grouped(findings);
  std::vector<std::string> lines;
  for (std::size_t i = 0; i < std::min(groups.size(), most); ++i) {
    const auto& [f, others] = groups[i];
    lines.push_back(fmt::format("{}{}{}{}: {}", f->severity == Severity::kError ? "wrong data: " : "data: ",
                                f->run.empty() ? "" : f->run + ": ", f->channel,
                                others > 0 ? fmt::format(" (and {} more like it)", others) : "", f->text));
  }
  if (groups.size() > most) {
    lines.push_back(fmt::format("data: and {} more; the report of `tendril gap diagnose` lists all",
                                groups.size() - most));
  }
  return lines;
}

std::vector<std::string> ErrorLines(const std::vector<HealthFinding>& findings) {
  std::vector<const HealthFinding*> first;
  std::map<std::string, int> runs;
  for (const HealthFinding& finding : findings) {
    if (finding.severity != Severity::kError) continue;
    if (runs[finding.channel]++ == 0) first.push_back(&finding);
  }
  std::vector<std::string> lines;
  for (const HealthFinding* finding : first) {
    const int others = runs[finding->channel] - 1;
    lines.push_back(fmt::format("{}{}: {} {}", finding->run,
                                others > 0 ? fmt::format(" and {} more", others) : "", finding->channel,
                                finding->text));
  }
  return lines;
}

}  // namespace tendril::gap
