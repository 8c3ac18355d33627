// Converts a diagnosis to JSON and back, using the field lists of report_fields.h. Knows nothing of the page.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <type_traits>

#include "file_bytes.h"
#include "report_fields.h"
#include "tendril/gap/report.h"
#include "tendril/gap/words.h"

namespace tendril::gap {
namespace {

using Json = nlohmann::ordered_json;
using sim::Cut;

constexpr int kFormat = 1;

// ---- names ------------------------------------------------------------------------------------------------

constexpr std::array<CutText, sim::kCuts> kCutTexts{{
    {"clocks", "time stamps", "counters"},
    {"current loop", "target torque", "actual torque"},
    {"drivetrain", "motor torque", "load cell"},
    {"tendon", "motor angle, shape", "tension"},
    {"shape", "tension", "shape at rest"},
    {"motion", "tension", "tip in motion"},
    {"sensors", "one sensor", "another"},
}};

// Suffixes of parameter names and their units; longer suffixes first.
constexpr std::array<std::pair<std::string_view, std::string_view>, 13> kUnits{{
    {"m_per_rad", "m/rad"},
    {"rad_per_m", "rad/m"},
    {"N_per_s", "N/s"},
    {"radps", "rad/s"},
    {"Npm", "N/m"},
    {"Nms", "N·m·s"},
    {"rad", "rad"},
    {"Nm", "N·m"},
    {"kg", "kg"},
    {"Pa", "Pa"},
    {"N", "N"},
    {"m", "m"},
    {"s", "s"},
}};

// ---- writing ----------------------------------------------------------------------------------------------

class Writer {
 public:
  template <class T>
  using Ref = const T&;
  explicit Writer(Json& to) : to_(to) {}
  template <class T>
  void operator()(const char* key, const T& value);

 private:
  Json& to_;
};

// ---- reading ----------------------------------------------------------------------------------------------

[[noreturn]] void Wrong(const std::string& at, const char* expected) {
  throw std::runtime_error(fmt::format("'{}' must be {}", at, expected));
}

class Reader {
 public:
  template <class T>
  using Ref = T&;
  Reader(const Json& from, std::string at) : from_(from), at_(std::move(at)) {
    if (!from_.is_object()) Wrong(at_.empty() ? "the report" : at_, "an object");
  }
  template <class T>
  void operator()(const char* key, T& value);

 private:
  const Json& from_;
  std::string at_;
};

std::string Below(const std::string& at, const std::string& key) { return at.empty() ? key : at + "." + key; }

// ---- values to JSON ---------------------------------------------------------------------------------------

Json ToJson(double v) { return std::isfinite(v) ? Json(v) : Json(nullptr); }
Json ToJson(int v) { return v; }
Json ToJson(std::uint64_t v) { return v; }
Json ToJson(bool v) { return v; }
Json ToJson(const std::string& v) { return v; }
Json ToJson(Cut v) { return std::string(sim::CutName(v)); }
Json ToJson(Verdict v) { return VerdictName(v); }
Json ToJson(HealthFinding::Severity v) { return kSeverities.at(static_cast<std::size_t>(v)); }
Json ToJson(const Estimate& v) {
  return {{"value", ToJson(v.value)}, {"ci", {ToJson(v.low), ToJson(v.high)}}};
}
Json ToJson(const std::map<std::string, Estimate>& v) {
  Json j = Json::object();
  for (const auto& [name, estimate] : v) j[name] = ToJson(estimate);
  return j;
}
Json ToJson(const std::pair<std::string, double>& v) {
  return {{"name", v.first}, {"value", ToJson(v.second)}};
}

template <class T>
Json ToJson(const T& v) requires std::is_class_v<T> {
  Json j = Json::object();
  Writer w(j);
  Fields(w, v);
  return j;
}

// The number in "tendon:2" under its own key, for other programs.
Json ToJson(const CutFinding& v) {
  Json j{{"cut", ToJson(v.cut)}};
  for (const std::string_view kind : {"tendon", "section"}) {
    int number = 0;
    if (!v.where.starts_with(kind) || v.where.size() < kind.size() + 2) continue;
    const char* end = v.where.data() + v.where.size();
    if (std::from_chars(v.where.data() + kind.size() + 1, end, number).ptr == end)
      j[std::string(kind)] = number;
  }
  Writer w(j);
  Fields(w, v);
  return j;
}

// Includes the registry's text on the effect and the names and units of its parameters, for the page; not
// read back.
Json ToJson(const Cause& v) {
  Json j = Json::object();
  Writer w(j);
  Fields(w, v);
  for (const auto& [name, estimate] : v.parameters) {
    const ParameterText text = TextOf(name);
    j["parameters"][name]["word"] = text.word;
    j["parameters"][name]["unit"] = text.unit;
    j["parameters"][name]["text"] = ParameterWords(name, estimate, true);
  }
  const sim::Effect* effect = sim::FindEffect(v.effect);
  j["about"] = effect ? std::string(effect->summary) : std::string();
  return j;
}

Json ToJson(const Profile& v) {
  Json j = Json::object();
  Writer w(j);
  Fields(w, v);
  const ParameterText text = TextOf(v.parameter);
  j["word"] = text.word;
  j["unit"] = text.unit;
  return j;
}

template <class T>
Json ToJson(const std::optional<T>& v) {
  return v ? ToJson(*v) : Json(nullptr);
}
template <class T>
Json ToJson(const std::vector<T>& v) {
  Json j = Json::array();
  for (const T& x : v) j.push_back(ToJson(x));
  return j;
}

template <class T>
void Writer::operator()(const char* key, const T& value) {
  to_[key] = ToJson(value);
}

// ---- JSON to values ---------------------------------------------------------------------------------------

void FromJson(const Json& j, const std::string& at, double& v) {
  if (!j.is_number() && !j.is_null()) Wrong(at, "a number or null");
  v = j.is_null() ? std::numeric_limits<double>::quiet_NaN() : j.get<double>();
}
void FromJson(const Json& j, const std::string& at, int& v) {
  if (!j.is_number_integer() || j < std::numeric_limits<int>::min() || j > std::numeric_limits<int>::max()) {
    Wrong(at, "a whole number");
  }
  v = j.get<int>();
}
void FromJson(const Json& j, const std::string& at, std::uint64_t& v) {
  if (!j.is_number_unsigned()) Wrong(at, "a whole number from 0");
  v = j.get<std::uint64_t>();
}
void FromJson(const Json& j, const std::string& at, bool& v) {
  if (!j.is_boolean()) Wrong(at, "true or false");
  v = j.get<bool>();
}
void FromJson(const Json& j, const std::string& at, std::string& v) {
  if (!j.is_string()) Wrong(at, "a text");
  v = j.get<std::string>();
}

template <std::size_t n>
std::size_t IndexOf(const Json& j, const std::string& at, const std::array<const char*, n>& names) {
  for (std::size_t i = 0; i < n; ++i) {
    if (j == names[i]) return i;
  }
  Wrong(at, fmt::format("one of {}", fmt::join(names, ", ")).c_str());
}
void FromJson(const Json& j, const std::string& at, Verdict& v) {
  v = static_cast<Verdict>(IndexOf(j, at, kVerdicts));
}
void FromJson(const Json& j, const std::string& at, HealthFinding::Severity& v) {
  v = static_cast<HealthFinding::Severity>(IndexOf(j, at, kSeverities));
}
void FromJson(const Json& j, const std::string& at, Cut& v) {
  for (int i = 0; i < sim::kCuts; ++i) {
    v = static_cast<Cut>(i);
    if (j == std::string(sim::CutName(v))) return;
  }
  Wrong(at, "a cut, C0 to C6");
}

const Json& Member(const Json& j, const std::string& at, const char* key) {
  if (!j.is_object()) Wrong(at, "an object");
  const auto it = j.find(key);
  if (it == j.end()) throw std::runtime_error(fmt::format("'{}' is missing", Below(at, key)));
  return *it;
}

void FromJson(const Json& j, const std::string& at, Estimate& v) {
  FromJson(Member(j, at, "value"), Below(at, "value"), v.value);
  const Json& ci = Member(j, at, "ci");
  if (!ci.is_array() || ci.size() != 2) Wrong(Below(at, "ci"), "[low, high]");
  FromJson(ci[0], Below(at, "ci[0]"), v.low);
  FromJson(ci[1], Below(at, "ci[1]"), v.high);
}
void FromJson(const Json& j, const std::string& at, std::map<std::string, Estimate>& v) {
  if (!j.is_object()) Wrong(at, "an object");
  for (const auto& [key, value] : j.items()) FromJson(value, Below(at, key), v[key]);
}
void FromJson(const Json& j, const std::string& at, std::pair<std::string, double>& v) {
  FromJson(Member(j, at, "name"), Below(at, "name"), v.first);
  FromJson(Member(j, at, "value"), Below(at, "value"), v.second);
}

template <class T>
void FromJson(const Json& j, const std::string& at, T& v) requires std::is_class_v<T> {
  Reader r(j, at);
  Fields(r, v);
}

void FromJson(const Json& j, const std::string& at, CutFinding& v) {
  FromJson(Member(j, at, "cut"), Below(at, "cut"), v.cut);
  Reader r(j, at);
  Fields(r, v);
}

template <class T>
void FromJson(const Json& j, const std::string& at, std::optional<T>& v) {
  v.reset();
  if (!j.is_null()) FromJson(j, at, v.emplace());
}
template <class T>
void FromJson(const Json& j, const std::string& at, std::vector<T>& v) {
  if (!j.is_array()) Wrong(at, "a list");
  v.clear();
  v.reserve(j.size());
  for (std::size_t i = 0; i < j.size(); ++i) FromJson(j[i], fmt::format("{}[{}]", at, i), v.emplace_back());
}

template <class T>
void Reader::operator()(const char* key, T& value) {
  FromJson(Member(from_, at_, key), Below(at_, key), value);
}

// ---- closed -----------------------------------------------------------------------------------------------

Json WriteClosed(const Diagnosis& d) {
  Json channels = Json::object();
  for (const Closure& c : d.closures) {
    Json j = c.closed ? ToJson(*c.closed) : Json{{"value", nullptr}, {"ci", nullptr}};
    j["before"] = ToJson(c.before_rms);
    j["after"] = ToJson(c.after_rms);
    j["ceiling"] = ToJson(c.ceiling_rms);
    if (c.as_filed_rms) j["as_filed"] = ToJson(*c.as_filed_rms);
    j["floor"] = ToJson(c.floor_rms);
    j["unit"] = c.unit;
    j["cut"] = ToJson(c.cut);
    j["channel"] = c.channel;
    // One channel may be judged at two cuts, but keys must be unique.
    std::string key = c.channel;
    if (channels.contains(key)) key += fmt::format(" ({})", sim::CutName(c.cut));
    for (int n = 2; channels.contains(key); ++n)
      key = fmt::format("{} ({}, {})", c.channel, sim::CutName(c.cut), n);
    channels[key] = std::move(j);
  }
  return {{"pooled", ToJson(d.closed)},
          {"ceiling", ToJson(d.closed_ceiling)},
          {"families", ToJson(d.families)},
          {"channels", std::move(channels)}};
}

void ReadClosed(const Json& j, Diagnosis& d) {
  FromJson(Member(j, "closed", "pooled"), "closed.pooled", d.closed);
  FromJson(Member(j, "closed", "ceiling"), "closed.ceiling", d.closed_ceiling);
  if (j.contains("families")) FromJson(j.at("families"), "closed.families", d.families);
  const Json& channels = Member(j, "closed", "channels");
  if (!channels.is_object()) Wrong("closed.channels", "an object");
  for (const auto& [key, value] : channels.items()) {
    const std::string at = Below("closed.channels", key);
    Closure c;
    Reader r(value, at);
    r("before", c.before_rms);
    r("after", c.after_rms);
    r("ceiling", c.ceiling_rms);
    if (value.contains("as_filed")) r("as_filed", c.as_filed_rms);
    r("floor", c.floor_rms);
    r("unit", c.unit);
    r("cut", c.cut);
    r("channel", c.channel);
    if (!Member(value, at, "ci").is_null()) FromJson(value, at, c.closed.emplace());
    d.closures.push_back(std::move(c));
  }
}

Json Chain() {
  Json chain = Json::array();
  for (int i = 0; i < sim::kCuts; ++i) {
    const auto cut = static_cast<Cut>(i);
    const CutText& text = TextOf(cut);
    chain.push_back({{"cut", ToJson(cut)}, {"title", text.title}, {"from", text.from}, {"to", text.to}});
  }
  return chain;
}

/// Display units, for the page.
Json Units() {
  Json units = Json::object();
  for (const auto& [unit, choices] : ShownUnits()) {
    for (const ShownUnit& shown : choices)
      units[std::string(unit)].push_back({ToJson(shown.below), shown.factor, std::string(shown.unit)});
  }
  return units;
}

}  // namespace

std::string VerdictName(Verdict verdict) { return kVerdicts.at(static_cast<std::size_t>(verdict)); }

const CutText& TextOf(Cut cut) { return kCutTexts.at(static_cast<std::size_t>(cut)); }

ParameterText TextOf(std::string_view parameter) {
  std::string_view word = parameter, unit;
  for (const auto& [ending, meaning] : kUnits) {
    if (parameter != ending && !parameter.ends_with(fmt::format("_{}", ending))) continue;
    word.remove_suffix(std::min(ending.size() + 1, word.size()));
    unit = meaning;
    break;
  }
  std::string words(word);
  std::replace(words.begin(), words.end(), '_', ' ');
  return {std::move(words), std::string(unit)};
}

std::string ReportJson(const Diagnosis& diagnosis) {
  const Diagnosis d = Condensed(diagnosis);
  Json j{{"format", kFormat}};
  Writer w(j);
  Fields(w, d);
  j["next_commands"] = ToJson(d.next_commands);
  j["free_runs"] = ToJson(d.free_runs);
  j["closed"] = WriteClosed(d);
  j["repeatability"] = ToJson(d.repeatability);
  j["chain"] = Chain();
  j["shown_units"] = Units();
  Json provenance = Json::object();
  Writer p(provenance);
  ProvenanceFields(p, d);
  j["provenance"] = std::move(provenance);
  // A run's name may contain any bytes; invalid UTF-8 is replaced.
  return j.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

Diagnosis ParseReport(const std::string& text) {
  Json j;
  try {
    j = Json::parse(text);
  } catch (const Json::parse_error& e) {
    throw std::runtime_error(fmt::format("is not JSON (byte {})", e.byte));
  }
  Diagnosis d;
  Reader r(j, "");
  int format = 0;
  r("format", format);
  if (format != kFormat) {
    throw std::runtime_error(fmt::format("has format {}, this program reads {}", format, kFormat));
  }
  Fields(r, d);
  // Reports of earlier versions have none.
  if (j.contains("next_commands")) FromJson(j.at("next_commands"), "next_commands", d.next_commands);
  if (j.contains("free_runs")) FromJson(j.at("free_runs"), "free_runs", d.free_runs);
  ReadClosed(Member(j, "", "closed"), d);
  // Missing in older reports.
  if (j.contains("repeatability")) FromJson(j["repeatability"], "repeatability", d.repeatability);
  Reader p(Member(j, "", "provenance"), "provenance");
  ProvenanceFields(p, d);
  return d;
}

Diagnosis ReadReport(const std::filesystem::path& file) {
  const std::string text = ReadBytes(file);
  try {
    return ParseReport(text);
  } catch (const std::exception& e) {
    throw std::runtime_error(
        fmt::format("{}: {}; it must be a report.json of tendril gap diagnose", file.string(), e.what()));
  }
}

}  // namespace tendril::gap
