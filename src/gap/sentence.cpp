// The first sentence of a diagnosis: where, why, how far it closes, what to do next. Knows nothing of how
// these were found.
#include "sentence.h"

#include <fmt/core.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <set>
#include <string_view>
#include <utility>

#include "parameters_by_deviation.h"
#include "tendril/gap/words.h"

namespace tendril::gap {

std::string NameOf(const Cause& cause) {
  return cause.where.empty() || cause.where == "all" ? cause.effect : cause.effect + " (" + cause.where + ")";
}

namespace {

/// A parameter that says how something goes on (a time constant, a direction), not how large it is.
bool IsShape(const Cause& cause, const std::string& name) {
  const sim::Effect* effect = sim::FindEffect(cause.effect);
  if (effect == nullptr) return true;
  const auto parameter = std::find_if(effect->parameters.begin(), effect->parameters.end(),
                                      [&](const sim::EffectParameter& p) { return p.name == name; });
  return parameter == effect->parameters.end() || parameter->shape;
}

/// The size of a cause, with every component where it has several, and that of the same law in the robot
/// file; shape parameters are only in the report.
std::string ValueOf(const Cause& cause, const RobotParameters& robot) {
  const auto law = sim::FindLaw(robot, {cause.effect, cause.where, {}});
  std::string value;
  for (const auto& [name, estimate] : ParametersByDeviation(cause)) {
    if (!value.empty() && IsShape(cause, name)) continue;
    value += (value.empty() ? "" : ", ") + ParameterWords(name, estimate, false);
    if (!law) continue;
    for (const auto& [its_name, its_value] : robot.effects[*law].values) {
      if (its_name == name) value += " where the robot file has " + ParameterValue(name, estimate, its_value);
    }
  }
  return value;
}

/// Something was measured at this cut.
bool Seen(const Diagnosis& d, sim::Cut cut) {
  return std::any_of(d.location.begin(), d.location.end(),
                     [&](const CutFinding& f) { return f.cut == cut && f.measured; });
}

/// Cuts without any measurement: "C4, C5".
std::string CutsNotSeen(const Diagnosis& d) {
  std::set<sim::Cut> seen;
  std::string names;
  for (const auto& f : d.location) {
    if (f.measured) seen.insert(f.cut);
  }
  for (const auto& f : d.location) {
    if (!seen.insert(f.cut).second) continue;
    names += names.empty() ? "" : ", ";
    names += sim::CutName(f.cut);
  }
  return names;
}

/// Where the gap begins; null: no place is marked.
const CutFinding* FirstFinding(const Diagnosis& d) {
  const auto first =
      std::find_if(d.location.begin(), d.location.end(), [](const CutFinding& f) { return f.first; });
  return first == d.location.end() ? nullptr : &*first;
}

/// The largest finding that is uncertain; null: none.
const CutFinding* UncertainFinding(const Diagnosis& d) {
  const CutFinding* off = nullptr;
  for (const auto& f : d.location) {
    if (f.uncertain() && (off == nullptr || f.excess_sigma > off->excess_sigma)) off = &f;
  }
  return off;
}

/// "The gap lies at C3 (tension, tendon:2)".
std::string WhereText(const Diagnosis& d) {
  const CutFinding *first = FirstFinding(d), *off = UncertainFinding(d);
  const bool nowhere =
      std::none_of(d.location.begin(), d.location.end(), [](const CutFinding& f) { return f.excess; });
  return first && first->cut == sim::Cut::kDrivetrain && !Seen(d, sim::Cut::kTendon)
             ? fmt::format(
                   "The gap lies at C2 or beyond (C2 to C5 cannot be told apart by place without load "
                   "cells; {}, {})",
                   first->quantity, first->where)
         : first ? fmt::format("The gap lies at {} ({}{})", sim::CutName(first->cut), first->quantity,
                               first->where == "all" ? "" : ", " + first->where)
         : off ? fmt::format("{} ({}) is {} sigma off, in too few seconds to be sure", sim::CutName(off->cut),
                             off->quantity, Sigmas(off->excess_sigma))
         : nowhere ? "All places together exceed the noise floor, but no single place does significantly"
                   : "The place of the gap is not clear";
}

/// The accepted causes with their size and probability, or the groups that they belong to.
std::string CausesText(const Diagnosis& d, const RobotParameters& robot) {
  std::string causes;
  bool grouped = false;
  for (const auto& c : d.accepted) {
    causes += causes.empty() ? "" : ", and ";
    std::string names;
    double group = 0;
    for (const auto& rival : d.causes) {
      if (c.group == 0 || rival.group != c.group) continue;
      names += (names.empty() ? "" : " or ") + NameOf(rival);
      group += rival.p;
    }
    if (!names.empty() && group < 0.5) names += " or another";
    if (d.verdict == Verdict::kAmbiguousGroup && !names.empty()) {
      causes += fmt::format("one of {}, which these runs cannot tell apart", names);
      grouped = true;
    } else {
      causes += fmt::format("{}, {} ({} likely)", NameOf(c), ValueOf(c, robot), Percent(c.p));
    }
  }
  if (d.verdict == Verdict::kAmbiguousGroup && !grouped) causes += ", or another";
  return causes;
}

/// What closes with the accepted causes, and what remains.
std::string ClosedText(const Diagnosis& d) {
  const std::string closed =
      d.closed && d.closed->low > 0
          ? fmt::format(" With it in the model {} of the gap closes on held-out {}.",
                        Percent(d.closed->value), d.held_out_by)
          : " It is too close to the noise floor to say how much of the gap it closes.";
  const std::string left =
      d.leftover_sigma < kMuchLeft_sigma
          ? ""
          : fmt::format(" Up to {} sigma beyond the floor remain: it is not the only cause.",
                        Sigmas(d.leftover_sigma));
  return closed + left;
}

/// To go on after a comma; "C2 ..." keeps its capital.
std::string LowerFirst(std::string sentence) {
  if (sentence.size() > 1 && std::islower(static_cast<unsigned char>(sentence[1])))
    sentence[0] = static_cast<char>(std::tolower(static_cast<unsigned char>(sentence[0])));
  return sentence;
}

}  // namespace

std::string Sentence(const Diagnosis& d, const RobotParameters& robot, const std::string& hiding) {
  const CutFinding *first = FirstFinding(d), *off = UncertainFinding(d);
  const std::string where = WhereText(d);
  const std::string next = d.next.family.empty() ? "" : fmt::format(" Next: run '{}'.", d.next.family);
  switch (d.verdict) {
    case Verdict::kNoGap: {
      const std::string blind = CutsNotSeen(d);
      return "No gap beyond the noise floor and the requested materiality" +
             (blind.empty() ? "." : "; these logs do not cover " + blind + ".");
    }
    case Verdict::kInsufficientData:
      return first ? where + ", but these logs and this model are not enough to identify its cause." + next
             : off ? where + " that this is a gap." + next
                   : "These logs are not enough to tell whether there is a gap." + next;
    case Verdict::kUnexplained: {
      if (!d.suspected.empty()) return where + ".";
      if (!hiding.empty())
        return fmt::format("{}, and no effect of the library explains it: {}.{}", where, hiding, next);
      if (!d.doubt.empty()) return where + "." + next;  // Preface() says why
      const auto best = std::find_if(d.causes.begin(), d.causes.end(),
                                     [](const Cause& c) { return sim::FindEffect(c.effect) != nullptr; });
      // Without a significant place, the sum over all places decided.
      const std::string remains =
          d.leftover_sigma == 0 && d.closed
              ? fmt::format("{} of it remains", Percent(1 - d.closed->value))
              : fmt::format("{} sigma beyond the floor remain", Sigmas(d.leftover_sigma));
      return fmt::format("{}, and no effect of the library explains it: {} with the best of them ({}).{}",
                         where, remains, best == d.causes.end() ? "none" : NameOf(*best), next);
    }
    case Verdict::kAttributed:
    case Verdict::kAmbiguousGroup:
      return fmt::format("{}; its cause is {}.{}{}", where, CausesText(d, robot), ClosedText(d), next);
  }
  return "";
}

std::string Preface(const Diagnosis& d) {
  if (!d.suspected.empty()) {
    std::string numbers;
    for (const SuspectNumber& number : d.suspected) {
      numbers += numbers.empty() ? "with " : ", or with ";
      numbers += fmt::format("{} {:.4g} where the file has {:.4g}", number.key, number.value, number.in_file);
    }
    const auto& closed = d.suspected.front().closed;
    return fmt::format("Check the robot file first: {} {} of this gap disappears, more than with any cause. ",
                       numbers, closed ? Percent(closed->value) : "most");
  }
  const auto likeliest = std::find_if(d.causes.begin(), d.causes.end(),
                                      [](const Cause& c) { return sim::FindEffect(c.effect) != nullptr; });
  if (d.doubt.empty() || likeliest == d.causes.end()) return "";
  return fmt::format("No cause is established: the likeliest is {}, but {}. ", NameOf(*likeliest), d.doubt);
}

std::string FewRunsRemark(const Diagnosis& d, const std::map<std::string, double>& missed) {
  std::string names;
  std::size_t few = 0;
  double most = 0;
  for (const auto& run : d.runs) {
    const auto found = missed.find(run.name);
    if (found == missed.end()) continue;
    names += (few++ ? ", " : "") + run.name;
    most = std::max(most, found->second);
  }
  if (d.verdict != Verdict::kUnexplained || few == 0 || 2 * few >= d.runs.size()) return "";
  return fmt::format(
      " It lies mainly in {}, with {}{:.0f} times the model error of the other {} runs: what was different "
      "then? Diagnose again without {}.",
      names, few == 1 ? "" : "up to ", most, d.runs.size() - few, few == 1 ? "it" : "them");
}

std::string WithLearned(const std::string& sentence, const std::vector<LearnedNumber>& learned) {
  constexpr std::size_t kNames = 4;
  constexpr double kMoved = 0.3;  // deviations of the prior
  if (learned.empty()) return sentence;
  std::string numbers;
  for (std::size_t k = 0; k < std::min(kNames, learned.size()); ++k) {
    const LearnedNumber& n = learned[k];
    if (k > 0 && std::abs(n.moved) < kMoved) break;
    numbers +=
        fmt::format("{}{} {:.4g} where the file has {:.4g}", k > 0 ? ", " : "", n.key, n.value, n.in_file);
  }
  return fmt::format(
      "With the numbers of the robot file fitted to these runs within their uncertainties ({}{}; `tendril "
      "gap "
      "apply` writes them): {}",
      numbers, learned.size() > kNames ? ", ..." : "", LowerFirst(sentence));
}

std::string WithLeftOut(const std::string& sentence, const std::vector<std::string>& notes,
                        std::size_t used) {
  constexpr std::string_view kMark = "left out: ";
  constexpr std::size_t kNames = 3, kReasons = 3;
  std::vector<std::pair<std::string, std::vector<std::string>>> by_reason;
  std::size_t left_out = 0;
  for (const std::string& note : notes) {
    if (!note.starts_with(kMark)) continue;
    ++left_out;
    std::string name, reason = note.substr(kMark.size());
    // A run's name, which may contain spaces; a summary of several runs has its unit in brackets there.
    if (const std::size_t colon = reason.find(": "); colon < reason.find('(')) {
      name = reason.substr(0, colon);
      reason.erase(0, colon + 2);
    }
    reason.erase(std::min(reason.size(), reason.find_first_of(";:(")));  // the rest is in the list of limits
    while (reason.ends_with(' ')) reason.pop_back();
    const auto found = std::find_if(by_reason.begin(), by_reason.end(),
                                    [&](const auto& its) { return its.first == reason; });
    auto& names = found != by_reason.end() ? found->second : by_reason.emplace_back(reason, 0).second;
    if (!name.empty()) names.push_back(name);
  }
  if (left_out == 0) return sentence;
  std::string reasons;
  for (std::size_t i = 0; i < std::min(kReasons, by_reason.size()); ++i) {
    const auto& [reason, names] = by_reason[i];
    reasons += i > 0 ? "; " : "";
    for (std::size_t k = 0; k < std::min(kNames, names.size()); ++k) reasons += (k ? ", " : "") + names[k];
    reasons += (names.size() > kNames ? ", ..." : "") + std::string(names.empty() ? "" : ": ") + reason;
  }
  if (by_reason.size() > kReasons) reasons += "; ...";
  return fmt::format("With {} of {} runs left out ({}), {}", left_out, left_out + used, reasons,
                     LowerFirst(sentence));
}

}  // namespace tendril::gap
