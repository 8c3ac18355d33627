// The contents of report.json as a list for the reference: the fields of report_fields.h with their types.
#include <cxxabi.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cstdlib>
#include <memory>
#include <typeinfo>

#include "report_fields.h"
#include "tendril/gap/report.h"

namespace tendril::gap {
namespace {

using sim::Cut;

// Keys with other names than their members.
constexpr std::pair<std::string_view, std::string_view> kOtherNames[] = {
    {"condition_maps", "maps"}, {"next_experiment", "next"}, {"data_health", "health"}};

class Lister {
 public:
  template <class T>
  using Ref = const T&;
  Lister(std::vector<ReportField>& fields, std::string owner, std::string at)
      : fields_(fields), owner_(std::move(owner)), at_(std::move(at)) {}
  template <class T>
  void operator()(const char* key, const T& value);

 private:
  std::vector<ReportField>& fields_;
  std::string owner_, at_;
};

constexpr const char* kEstimate = "{value, ci: [low, high]}, a 95 % interval";

const char* TypeText(const double&) { return "number or null"; }
const char* TypeText(const int&) { return "whole number"; }
const char* TypeText(const std::uint64_t&) { return "whole number"; }
const char* TypeText(const bool&) { return "true or false"; }
const char* TypeText(const std::string&) { return "text"; }
const char* TypeText(const Cut&) { return "C0 .. C6"; }
const char* TypeText(const Estimate&) { return kEstimate; }
const char* TypeText(const std::map<std::string, Estimate>&) { return "object: an estimate for each name"; }
const char* TypeText(const std::pair<std::string, double>&) { return "{name, value}"; }
std::string TypeText(const Verdict&) { return fmt::format("{}", fmt::join(kVerdicts, ", ")); }
std::string TypeText(const HealthFinding::Severity&) {
  return fmt::format("{}", fmt::join(kSeverities, ", "));
}
template <class T>
std::string TypeText(const std::optional<T>&) {
  return fmt::format("{}, or null", TypeText(T()));
}
template <class T>
std::string TypeText(const std::vector<T>&) {
  if constexpr (requires { TypeText(T()); }) return fmt::format("list of: {}", TypeText(T()));
  return "list of objects";
}

/// "CutFinding": the structure whose members the fields are.
template <class T>
std::string NameOfType() {
  const std::unique_ptr<char, void (*)(void*)> name(
      abi::__cxa_demangle(typeid(T).name(), nullptr, nullptr, nullptr), std::free);
  const std::string full = name.get();
  return full.substr(full.rfind(':') + 1);
}

template <class T>
void ListFields(std::vector<ReportField>& fields, const std::string& at) {
  Lister lister(fields, NameOfType<T>(), at);
  Fields(lister, T());
}

template <class T>
void ListBelow(std::vector<ReportField>& fields, const std::string& at, const T&) {
  if constexpr (requires(Lister a, T v) { Fields(a, v); }) ListFields<T>(fields, at + ".");
}
template <class T>
void ListBelow(std::vector<ReportField>& fields, const std::string& at, const std::vector<T>&) {
  ListBelow(fields, at + "[]", T());
}

template <class T>
void Lister::operator()(const char* key, const T& value) {
  std::string type = "object";
  if constexpr (requires { TypeText(value); }) type = TypeText(value);
  std::string_view member = key;
  for (const auto& [name, other] : kOtherNames) member = member == name ? other : member;
  fields_.push_back({at_ + key, std::move(type), fmt::format("{}::{}", owner_, member), ""});
  ListBelow(fields_, at_ + key, value);
}

}  // namespace

// Fields() and the few that report_json.cpp writes by itself.
std::vector<ReportField> ReportFields() {
  std::vector<ReportField> fields;
  const auto add = [&](const char* path, const char* type, const char* meaning) {
    fields.push_back({path, type, "", meaning});
  };
  add("format", "whole number", "Version of this layout; raised when a reader must know of a change.");
  ListFields<Diagnosis>(fields, "");
  for (const char* list : {"causes", "accepted"}) {
    fields.push_back({fmt::format("{}[].about", list), "text", "", "The registry's summary of the effect."});
    fields.push_back({fmt::format("{}[].parameters.NAME", list), kEstimate, "",
                      "The parameter, with `word`, `unit` and `text`, which say it in words."});
  }
  add("location[].cut", "C0 .. C6", "The place in the chain.");
  add("location[].tendon", "whole number", "The number of `where`, when it is one tendon.");
  add("location[].section", "whole number", "The number of `where`, when it is one section.");
  for (const char* key : {"word", "unit"})
    fields.push_back(
        {fmt::format("profiles[].{}", key), "text", "", "The parameter's word or unit, for people."});
  fields.push_back({"next_commands", "list of: text", "Diagnosis::next_commands", ""});
  fields.push_back({"free_runs", "list of objects", "Diagnosis::free_runs", ""});
  ListFields<FreeRun>(fields, "free_runs[].");
  fields.push_back({"closed.pooled", TypeText(std::optional<Estimate>()), "Diagnosis::closed", ""});
  fields.push_back({"closed.ceiling", TypeText(std::optional<Estimate>()), "Diagnosis::closed_ceiling", ""});
  ListFields<FamilyClosure>(fields, "closed.families[].");
  fields.push_back({"repeatability", "object or null", "Diagnosis::repeatability", ""});
  ListFields<Repeatability>(fields, "repeatability.");
  add("closed.channels.NAME", kEstimate,
      "Share of the channel's gap that closes; null where none is established.");
  add("closed.channels.NAME.before", "number",
      "Rms of the residual with the nominal robot, on held-out runs.");
  add("closed.channels.NAME.after", "number", "The same with the accepted causes.");
  add("closed.channels.NAME.ceiling", "number or null", "The same with everything refitted at once.");
  add("closed.channels.NAME.as_filed", "number",
      "The same with the numbers of the robot file, where `before` has those learned from earlier runs.");
  add("closed.channels.NAME.floor", "number", "What noise and repetition explain.");
  add("closed.channels.NAME.unit", "text", "Unit of these.");
  add("closed.channels.NAME.cut", "C0 .. C6", "The place in the chain.");
  add("closed.channels.NAME.channel", "text", "The channel, which may be judged at two cuts.");
  add("chain[].cut", "C0 .. C6", "A place in the chain, in order.");
  add("chain[].title", "text", "Its name.");
  add("chain[].from", "text", "What is known on its near side.");
  add("chain[].to", "text", "What is compared on its far side.");
  add("shown_units.UNIT[]", "[below, factor, unit]", "How the page shows values below a size.");
  Lister provenance(fields, "Diagnosis", "provenance.");
  ProvenanceFields(provenance, Diagnosis());
  return fields;
}

}  // namespace tendril::gap
