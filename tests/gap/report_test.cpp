// The report: the contract of report.json with other programs, a page that opens offline and is safe against
// names in the data, and a summary that fits the terminal. Knows nothing of how diagnoses are made.
#include "tendril/gap/report.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <sstream>

#include "gap/sentence.h"
#include "report_examples.h"
#include "tendril/gap/words.h"

namespace tendril::gap {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using testing::HasSubstr;
using testing::Not;

constexpr std::array kAllVerdicts{Verdict::kNoGap, Verdict::kAttributed, Verdict::kAmbiguousGroup,
                                  Verdict::kUnexplained, Verdict::kInsufficientData};

Json Parsed(const Diagnosis& d) { return Json::parse(ReportJson(d)); }

std::string Read(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

int Count(const std::string& text, const std::string& word) {
  int n = 0;
  for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) ++n;
  return n;
}

class Folder {
 public:
  Folder() : path_(fs::temp_directory_path() / fmt::format("tendril_report_{}_{}", getpid(), count_++)) {}
  ~Folder() { fs::remove_all(path_); }
  const fs::path& path() const { return path_; }

 private:
  static inline int count_ = 0;
  fs::path path_;
};

// Hostile or careless names of runs, channels and robots.
const std::string kHostile =
    "</script><script>document.documentElement.dataset.hurt=1</script>\"><img src=x "
    "onerror='document.documentElement.dataset.hurt=1'>${hurt}{{script}} & 'Größe' 机器人 \x1b[31m\r\n\t\\";
const std::string kNotUtf8 = "caf\xe9 \xff\xfe";

Diagnosis Hostile() {
  Diagnosis d = ExampleDiagnosis(Verdict::kAmbiguousGroup);
  d.sentence += kHostile + kNotUtf8;
  d.robot_name = kHostile + kNotUtf8;
  d.robot_yaml = kHostile;
  d.command = kHostile;
  for (RunSummary& r : d.runs) r.name += kHostile;
  for (Overlay& o : d.overlays) {
    o.run += kHostile;
    o.channel += kNotUtf8;
    o.unit += kHostile;
    o.against += kHostile;
  }
  for (ConditionMap& m : d.maps) m.condition += kHostile;
  for (Closure& c : d.closures) c.channel += kHostile;
  for (CutFinding& f : d.location) f.note = f.quantity = kHostile;
  for (Cause& c : d.causes) {
    c.note = kHostile;
    c.parameters[kHostile] = {1, 0, 2};
  }
  Cause& cause = d.causes.emplace_back();
  cause.effect = cause.where = kHostile;
  cause.p = 0.3;
  cause.group = 1;
  d.confusable.push_back({kHostile, kHostile + " b", 0.99, 0.1, true});
  d.health.push_back({HealthFinding::Severity::kWarning, kHostile, kHostile, 1, kHostile});
  d.degradations.push_back(kHostile);
  d.next.yaml = d.next.reason = kHostile;
  d.next.family += kHostile;
  d.input_correlations.emplace_back(kHostile, 0.4);
  d.order_effects.emplace_back(kHostile, 0.4);
  return d;
}

Diagnosis Undefined() {
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  Diagnosis d = ExampleDiagnosis(Verdict::kAttributed);
  for (CutFinding& f : d.location) f.rms = f.p_value = nan;
  for (Cause& c : d.causes) {
    c.held_out_gain = nan;
    for (auto& [name, e] : c.parameters) e = {nan, -inf, inf};
  }
  d.causes[1].p = nan;
  d.closed = Estimate{0.5, nan, nan};
  d.closed_ceiling = Estimate{nan, nan, nan};
  for (Closure& c : d.closures) c.after_rms = c.floor_rms = nan;
  for (Overlay& o : d.overlays) {
    o.floor = nan;
    for (std::size_t i = 0; i < o.measured.size(); i += 3) o.measured[i] = i % 2 ? nan : inf;
  }
  for (ConditionMap& m : d.maps) m.low[2] = m.mean[3] = m.at[4] = nan;
  for (Profile& p : d.profiles) p.score[0] = inf;
  for (HorizonPoint& h : d.horizon) h.floor_m = nan;
  for (FreeRun& f : d.free_runs) f.before_m = inf;
  for (Confusion& c : d.confusable) c.cosine = c.profile_gap = nan;
  d.leftover_sigma = inf;
  d.input_correlations[0].second = nan;
  d.health[0].value = nan;
  return d;
}

Diagnosis Empty() { return {}; }

Diagnosis Pair() {
  Diagnosis d = ExampleDiagnosis(Verdict::kAttributed);
  d.accepted.push_back(d.causes[1]);
  d.order_effects = {{"motor_coulomb alone", 0.71},
                     {"capstan_alpha after motor_coulomb", 0.22},
                     {"capstan_alpha alone", 0.35},
                     {"motor_coulomb after capstan_alpha", 0.58}};
  return d;
}

// The model made it worse on the held-out runs.
Diagnosis Worse() {
  Diagnosis d = ExampleDiagnosis(Verdict::kUnexplained);
  d.closed = Estimate{-0.4, -0.9, 0.1};
  for (Closure& c : d.closures) c.closed = Estimate{-0.4, -0.9, 0.1};
  return d;
}

std::vector<Diagnosis> All() {
  std::vector<Diagnosis> all;
  for (const Verdict v : kAllVerdicts) all.push_back(ExampleDiagnosis(v));
  for (const Diagnosis& d : {Hostile(), Undefined(), Empty(), Pair(), Worse()}) all.push_back(d);
  return all;
}

// ---- report.json ------------------------------------------------------------------------------------------

TEST(ReportJson, HasWhatOtherProgramsRelyOn) {
  const Diagnosis d = ExampleDiagnosis(Verdict::kAttributed);
  const Json j = Parsed(d);
  EXPECT_EQ(j.at("verdict"), "attributed");

  ASSERT_EQ(j.at("location").size(), d.location.size());
  std::string before = "C0";
  int firsts = 0;
  for (std::size_t i = 0; i < d.location.size(); ++i) {
    const Json& l = j["location"][i];
    EXPECT_LE(before, l.at("cut").get<std::string>()) << "not in chain order";
    before = l["cut"];
    EXPECT_EQ(l.at("excess_sigma"), d.location[i].excess_sigma);
    firsts += l.at("first").get<bool>();
    const std::string& where = d.location[i].where;
    EXPECT_EQ(l.contains("tendon"), where.starts_with("tendon:")) << where;
    EXPECT_EQ(l.contains("section"), where.starts_with("section:")) << where;
    if (l.contains("tendon")) {
      EXPECT_EQ(fmt::format("tendon:{}", l["tendon"].get<int>()), where);
    }
  }
  EXPECT_GE(firsts, 1);

  std::vector<std::string> effects;
  double p = 1;
  for (const Json& c : j.at("causes")) {
    effects.push_back(c.at("effect"));
    EXPECT_LE(c.at("p").get<double>(), p) << "not sorted";
    p = c["p"];
    EXPECT_TRUE(c.at("where").is_string());
    EXPECT_TRUE(c.at("group").is_number_integer());
    for (const auto& [name, e] : c.at("parameters").items()) {
      EXPECT_TRUE(e.at("value").is_number()) << name;
      ASSERT_EQ(e.at("ci").size(), 2u) << name;
      EXPECT_LE(e["ci"][0].get<double>(), e["ci"][1].get<double>()) << name;
    }
  }
  EXPECT_THAT(effects, testing::IsSupersetOf({"no_gap", "unknown", "motor_coulomb"}));
  EXPECT_EQ(j["causes"][0]["parameters"]["scale"]["value"], 1.84);

  const Json& closed = j.at("closed");
  EXPECT_EQ(closed.at("pooled").at("value"), d.closed->value);
  EXPECT_EQ(closed["pooled"].at("ci")[0], d.closed->low);
  ASSERT_EQ(closed.at("channels").size(), d.closures.size());
  const Json& tip = closed["channels"].at("tip position");
  for (const char* key : {"value", "before", "after", "floor"}) EXPECT_TRUE(tip.at(key).is_number()) << key;
  EXPECT_EQ(tip.at("unit"), "m");
  EXPECT_EQ(tip.at("ci").size(), 2u);

  EXPECT_TRUE(j.at("confusable").is_array());
  EXPECT_TRUE(j.at("next_experiment").is_object());
  EXPECT_EQ(j.at("data_health").size(), d.health.size());
  EXPECT_EQ(j.at("provenance").at("runs")[0].at("sha256"), d.runs[0].sha256);
  EXPECT_EQ(j["provenance"].at("seed"), d.seed) << "all 64 bits of it";
}

TEST(ReportJson, AlwaysSaysHowLikelyNoGapAndUnknownAre) {
  const Json j = Parsed(Empty());
  EXPECT_EQ(j["causes"].size(), 2u);
  EXPECT_EQ(j["closed"]["pooled"], nullptr);
}

TEST(ReportJson, ReportsOfEarlierVersionsAreRead) {
  Json old = Parsed(ExampleDiagnosis(Verdict::kAttributed));
  old.erase("next_commands");
  old.erase("shown_units");
  EXPECT_TRUE(ParseReport(old.dump()).next_commands.empty());
}

TEST(ReportJson, ComesBackAsItWas) {
  for (const Diagnosis& d : All()) {
    const std::string once = ReportJson(d);
    EXPECT_EQ(ReportJson(ParseReport(once)), once) << VerdictName(d.verdict);
  }
}

// Changing any single value of the file must change what is read: otherwise a value that is written is not
// read back.
TEST(ReportJson, NoNumberOrTextOfTheFileIsIgnored) {
  Diagnosis d = ExampleDiagnosis(Verdict::kAmbiguousGroup);
  for (Overlay& o : d.overlays) {
    for (auto* curve : {&o.time_s, &o.measured, &o.before, &o.after, &o.x}) {
      if (!curve->empty()) *curve = {curve->front(), curve->back()};
    }
  }
  d.maps.resize(1);
  for (auto* curve : {&d.maps[0].at, &d.maps[0].mean, &d.maps[0].low, &d.maps[0].high, &d.maps[0].after}) {
    *curve = {curve->front(), curve->back()};
  }
  d.profiles.resize(1);
  for (auto* curve : {&d.profiles[0].value, &d.profiles[0].score}) *curve = {curve->front(), curve->back()};
  d.location.resize(7);
  d.causes.resize(4);
  d.closures.resize(3);
  d.confusable.resize(2);
  d.horizon.resize(2);
  d.runs.resize(1);
  d.order_effects = {{"a", 0.5}};
  d.repeatability = {sim::Cut::kDrivetrain, "tendon:2", "tension", "N", 0.04, 0.01, 3.9,
                     "tension 2",           0.002,      true};
  const Json original = Parsed(d);
  int changed = 0;
  const Json flat = original.flatten();
  for (const auto& [pointer, value] : flat.items()) {
    // Derived from other fields or from the registry, not read.
    if (std::regex_search(pointer, std::regex("^/(chain|format|verdict|shown_units)|"
                                              "/(about|tendon|section|cut|severity|word|text)$|/"
                                              "scale/unit$|^/profiles/0/unit$")))
      continue;
    Json other = original;
    Json& leaf = other[Json::json_pointer(pointer)];
    if (leaf.is_number_float()) {
      leaf = 0.0625;  // survives the rounding of curves
    } else if (leaf.is_number_unsigned()) {
      leaf = leaf.get<std::uint64_t>() - (leaf == 0 ? 0 : 1);
    } else if (leaf.is_boolean()) {
      leaf = !leaf.get<bool>();
    } else if (leaf.is_string()) {
      leaf = leaf.get<std::string>() + "x";
    } else {
      continue;
    }
    if (pointer.ends_with("/p") || (other == original)) continue;  // would sort the causes anew
    Json back = Json::parse(ReportJson(ParseReport(other.dump())));
    // Texts are derived from the number beside them.
    for (Json* j : {&other, &back}) {
      for (const auto& [at, text] : flat.items()) {
        if (at.ends_with("/text") && at.find("/parameters/") != std::string::npos)
          (*j)[Json::json_pointer(at)] = "";
      }
    }
    // A renamed channel takes its key with it, a renamed place its number.
    if (pointer.ends_with("/channel") && pointer.starts_with("/closed")) {
      EXPECT_THAT(back["closed"]["channels"].dump(), HasSubstr(leaf.get<std::string>())) << pointer;
    } else if (pointer.ends_with("/effect") || pointer.ends_with("/parameter")) {
      EXPECT_THAT(back.dump(), HasSubstr(leaf.get<std::string>())) << pointer;
    } else if (pointer.starts_with("/location") && pointer.ends_with("/where")) {
      EXPECT_EQ(back[Json::json_pointer(pointer)], leaf) << pointer;
    } else {
      EXPECT_TRUE(back == other) << pointer << ": " << Json::diff(other, back).dump();
    }
    ++changed;
  }
  EXPECT_GT(changed, 200);
}

TEST(ReportJson, ReportsFromBeforeRepetitionsWereJudgedAreRead) {
  Json j = Parsed(ExampleDiagnosis(Verdict::kAttributed));
  EXPECT_EQ(j.at("repeatability"), nullptr);
  j.erase("repeatability");
  EXPECT_FALSE(ParseReport(j.dump()).repeatability);
}

TEST(ReportJson, HasOnlyFiniteNumbers) {
  const std::string text = ReportJson(Undefined());
  EXPECT_THAT(text, Not(testing::ContainsRegex("[Nn]a[Nn][^a-z]|[Ii]nf[,\\n ]")));
  const Json j = Json::parse(text);
  EXPECT_EQ(j["location"][0]["rms"], nullptr);
  EXPECT_EQ(j["leftover_sigma"], nullptr);
  EXPECT_TRUE(std::isnan(ParseReport(text).location[0].rms));
}

TEST(ReportJson, DiffersBetweenEqualRunsOnlyInTheTimeTheyTook) {
  Diagnosis a = ExampleDiagnosis(Verdict::kAttributed), b = a;
  b.seconds = 99;
  Json one = Parsed(a), other = Parsed(b);
  EXPECT_NE(one, other);
  one["provenance"].erase("seconds");
  other["provenance"].erase("seconds");
  EXPECT_EQ(one.dump(), other.dump());
}

TEST(ReportJson, NamesTheUnitOfEachParameter) {
  const auto text = [](const char* name) { return TextOf(name).word + "|" + TextOf(name).unit; };
  EXPECT_EQ(text("mass_kg"), "mass|kg");
  EXPECT_EQ(text("rad"), "|rad");
  EXPECT_EQ(text("scale"), "scale|");
  EXPECT_EQ(text("torque_Nm"), "torque|N·m");
  EXPECT_EQ(text("speed_radps"), "speed|rad/s");
  EXPECT_EQ(text("m_per_rad"), "|m/rad");
  EXPECT_EQ(text("periods_per_turn"), "periods per turn|");
  EXPECT_EQ(text("softening"), "softening|");
  // Every parameter of the registry but pure numbers has one.
  const std::set<std::string_view> pure{"scale",  "mu",         "fraction",   "softening",
                                        "spread", "compliance", "shortening", "periods_per_turn"};
  for (const sim::Effect& e : sim::Effects()) {
    for (const sim::EffectParameter& p : e.parameters) {
      EXPECT_EQ(TextOf(p.name).unit.empty(), pure.contains(p.name)) << e.name << " " << p.name;
    }
  }
}

TEST(ReportJson, ChannelsOfOneNameAreAllKept) {
  Diagnosis d;
  for (const sim::Cut cut : {sim::Cut::kShape, sim::Cut::kMotion, sim::Cut::kMotion}) {
    Closure c;
    c.channel = "tip position";
    c.cut = cut;
    c.before_rms = 1e-3 * (1 + static_cast<double>(d.closures.size()));
    d.closures.push_back(c);
  }
  const Diagnosis back = ParseReport(ReportJson(d));
  ASSERT_EQ(back.closures.size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(back.closures[i].channel, "tip position");
    EXPECT_EQ(back.closures[i].before_rms, d.closures[i].before_rms);
  }
}

TEST(ReportJson, ThinnedCurvesKeepTheirExtremesAndStayTheSame) {
  Diagnosis d;
  Overlay o;
  for (int i = 0; i < 60000; ++i) {
    o.time_s.push_back(1e-3 * i);
    o.measured.push_back(std::sin(1e-3 * i));
    o.before.push_back(std::sin(1e-3 * i) - (i == 31234 ? 0.5 : 0));
  }
  o.measured[12345] = 7;
  d.overlays = {o};
  const Diagnosis once = Condensed(d);
  const Overlay& thin = once.overlays[0];
  EXPECT_LE(thin.time_s.size(), 1200u);
  EXPECT_GE(thin.time_s.size(), 400u);
  EXPECT_EQ(thin.time_s.front(), 0);
  EXPECT_NEAR(thin.time_s.back(), 59.999, 1e-9);
  EXPECT_TRUE(std::is_sorted(thin.time_s.begin(), thin.time_s.end()));
  EXPECT_EQ(*std::max_element(thin.measured.begin(), thin.measured.end()), 7);
  double missed = 0;
  for (std::size_t i = 0; i < thin.time_s.size(); ++i) {
    if (std::abs(thin.time_s[i] - 31.234) < 1e-9) missed = thin.measured[i] - thin.before[i];
  }
  EXPECT_NEAR(missed, 0.5, 1e-5) << "a short spike of the residual is gone";
  EXPECT_EQ(Condensed(once).overlays[0].measured, thin.measured);

  d.overlays[0].after = {1, 2};
  EXPECT_THROW(Condensed(d), std::runtime_error) << "curves of different lengths";
}

TEST(ReadReport, SaysWhatIsWrongWithAFile) {
  const Folder folder;
  fs::create_directories(folder.path());
  const fs::path file = folder.path() / "report.json";
  const auto complaint = [&](const std::string& text) {
    std::ofstream(file) << text;
    try {
      ReadReport(file);
    } catch (const std::runtime_error& e) {
      return std::string(e.what());
    }
    return std::string("accepted");
  };
  EXPECT_THAT(complaint(""), HasSubstr("is not JSON"));
  EXPECT_THAT(complaint("[]"), HasSubstr("must be an object"));
  EXPECT_THAT(complaint("{}"), HasSubstr("'format' is missing"));
  EXPECT_THAT(complaint("{\"format\": 77}"), HasSubstr("format 77"));
  const std::string good = ReportJson(ExampleDiagnosis(Verdict::kAttributed));
  EXPECT_THAT(complaint(good.substr(0, good.size() / 2)), HasSubstr("is not JSON"));
  const auto with = [&](const std::string& pointer, const Json& value) {
    Json j = Json::parse(good);
    j[Json::json_pointer(pointer)] = value;
    return complaint(j.dump());
  };
  EXPECT_THAT(with("/causes/1/p", "high"), HasSubstr("'causes[1].p' must be a number"));
  EXPECT_THAT(with("/verdict", "perhaps"), HasSubstr("'verdict' must be one of no_gap, attributed"));
  EXPECT_THAT(with("/location/0/cut", "C9"), HasSubstr("'location[0].cut' must be a cut"));
  EXPECT_THAT(with("/causes/0/parameters/scale/ci", {1}), HasSubstr("ci' must be [low, high]"));
  EXPECT_THAT(with("/overlays", 3), HasSubstr("'overlays' must be a list"));
  EXPECT_THAT(with("/provenance/runs/0/samples", 1e300), HasSubstr("must be a whole number"));
  EXPECT_THROW(ReadReport(folder.path() / "none.json"), std::runtime_error);
  EXPECT_THROW(ReadReport(folder.path()), std::runtime_error);
}

// ---- words ------------------------------------------------------------------------------------------------

TEST(Words, AShareIsRoundedOneWay) {
  for (const auto& [share, text] : std::initializer_list<std::pair<double, const char*>>{{0, "0 %"},
                                                                                         {0.004, "<1 %"},
                                                                                         {0.006, "1 %"},
                                                                                         {0.99, "99 %"},
                                                                                         {0.994, "99 %"},
                                                                                         {0.996, ">99 %"},
                                                                                         {1, "100 %"},
                                                                                         {-0.001, "0 %"},
                                                                                         {-0.42, "-42 %"},
                                                                                         {NAN, "-"}})
    EXPECT_EQ(Percent(share), text) << share;
}

TEST(Words, AValueHasOneUnitAndTheDigitsOfItsInterval) {
  EXPECT_EQ(WithUnit(3.14159e-4, "m"), "0.314 mm");
  EXPECT_EQ(WithUnit(3.1e-5, "m"), "0.031 mm");
  EXPECT_EQ(WithUnit(3.1e-6, "m"), "3.1 µm");
  EXPECT_EQ(WithUnit(0.02, "rad"), "1.15°");
  EXPECT_EQ(WithUnit(-0.012, "N"), "-12 mN");
  EXPECT_EQ(WithUnit(std::numeric_limits<double>::infinity(), "N"), "-");
  EXPECT_EQ(ParameterWords("rad", {0.04947, 0.0487, 0.0502}, true), "2.834° [2.790, 2.876]");
  EXPECT_EQ(ParameterWords("mass_kg", {0.001997, 0.001982, 0.002013}, true), "mass 1.997 g [1.982, 2.013]");
  EXPECT_EQ(ParameterWords("scale", {1.84, 1.79, 1.90}, false), "scale × 1.84");
  EXPECT_EQ(ParameterWords("mu", {0.1234567, 0.1234566, 0.1234568}, true), "mu 0.1235 [0.1235, 0.1235]");
  EXPECT_EQ(ParameterWords("mu", {0.12, 0.12, 0.12}, true), "mu 0.12");
  EXPECT_EQ(ParameterValue("rad", {0.2, 0.19, 0.21}, 0.1), "5.7°");
}

// The terminal, the file and the page have their words of a parameter from one place.
TEST(Words, AreTheSameOnTheTerminalAndInTheFile) {
  for (const Diagnosis& d : All()) {
    const Json j = Parsed(d);
    const std::string summary = Summary(d);
    const Cause likeliest = Condensed(d).causes.front();
    for (const auto& [name, e] : likeliest.parameters) {
      const std::string text = ParameterWords(name, e, true);
      EXPECT_EQ(j["causes"][0]["parameters"][name]["text"].get<std::string>().substr(0, 20),
                text.substr(0, 20));
      if (text.size() < 40) {
        EXPECT_THAT(summary, HasSubstr(text));
      }
    }
  }
}

TEST(Words, RunsLeftOutAreInTheFirstSentence) {
  const std::string found = "The gap lies at C4 (tip position).";
  EXPECT_EQ(WithLeftOut(found, {"a.csv: 3 gaps", "tension is left out of it"}, 7), found);
  EXPECT_EQ(
      WithLeftOut(found,
                  {"left out: a: too short (12 rows; accepted: at least 50)", "something else",
                   "left out: b: too short (13 rows; accepted: at least 50)",
                   "left out: cannot read set/04.csv: no such file"},
                  4),
      "With 3 of 7 runs left out (a, b: too short; cannot read set/04.csv: no such file), the gap lies at C4 "
      "(tip position).");
  EXPECT_EQ(
      WithLeftOut("C2 (torque) is off.", {"left out: a: its motors were told otherwise; accepted: alike"}, 1),
      "With 1 of 2 runs left out (a: its motors were told otherwise), C2 (torque) is off.");
  std::vector<std::string> many;
  for (int i = 0; i < 30; ++i) many.push_back(fmt::format("left out: run_{}: reason {}", i, i % 5));
  EXPECT_LT(WithLeftOut("No gap.", many, 1).size(), 160u);
}

// ---- report.html ------------------------------------------------------------------------------------------

TEST(ReportPage, NeedsNothingFromOutside) {
  const std::string page = ReportPage(ExampleDiagnosis(Verdict::kAttributed));
  EXPECT_THAT(page, HasSubstr("Content-Security-Policy\" content=\"default-src 'none'"));
  const std::regex outside(
      "(src|href|action|data)\\s*=\\s*[\"']?(https?:|//|file:)|@import|url\\(\\s*[\"']?[^#\\s)\"'$]",
      std::regex::icase);
  // The plotting library and its licence contain addresses that are not fetched.
  std::istringstream lines(page);
  for (std::string line; std::getline(lines, line);) {
    if (line.size() > 50000) continue;
    std::smatch found;
    EXPECT_FALSE(std::regex_search(line, found, outside)) << line;
  }
  EXPECT_EQ(Count(page, "<script"), Count(page, "</script>"));
  EXPECT_THAT(page, Not(HasSubstr("{{")));
}

TEST(ReportPage, HoldsTheSameNumbersAsTheJsonFile) {
  for (const Diagnosis& d : All()) {
    const std::string page = ReportPage(d);
    const std::string open = "<script type=\"application/json\" id=\"data\">";
    const std::size_t begin = page.find(open) + open.size();
    EXPECT_EQ(Json::parse(page.substr(begin, page.find("</script>", begin) - begin)), Parsed(d));
  }
}

TEST(ReportPage, NamesInTheDataCannotBecomeMarkup) {
  const std::string calm = ReportPage(ExampleDiagnosis(Verdict::kAmbiguousGroup)),
                    page = ReportPage(Hostile());
  for (const char* mark : {"<script", "</script", "<img", "<!--"})
    EXPECT_EQ(Count(page, mark), Count(calm, mark)) << mark;
  EXPECT_THAT(page, HasSubstr("&lt;img src=x"));
}

TEST(ReportPage, StaysSmall) {
  EXPECT_LT(ReportPage(ExampleDiagnosis(Verdict::kAttributed)).size(), 1'000'000u);
  // Eight tendons and a tip in six runs of a minute each at 1 kHz.
  Diagnosis d = ExampleDiagnosis(Verdict::kAttributed);
  Overlay o;
  o.unit = "N";
  o.against = "displacement";
  for (int i = 0; i < 60000; ++i) {
    o.time_s.push_back(1e-3 * i);
    for (auto* curve : {&o.measured, &o.before, &o.after, &o.x}) curve->push_back(std::sin(0.37 * i) * M_PI);
  }
  d.overlays.assign(66, o);
  while (d.maps.size() < 200) d.maps.push_back(d.maps[d.maps.size() % 7]);
  EXPECT_LT(ReportPage(d).size(), 2'000'000u);
}

std::string Chromium() {
  for (const char* path : {"/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"}) {
    if (access(path, X_OK) == 0) return path;
  }
  return "";
}

std::string WithoutScripts(const std::string& dom) {
  std::string out;
  for (std::size_t at = 0; at < dom.size();) {
    const std::size_t open = dom.find("<script", at);
    out += dom.substr(at, open == std::string::npos ? open : open - at);
    if (open == std::string::npos) break;
    at = std::min(dom.size(), dom.find("</script>", open));
  }
  return out;
}

struct Drawn {
  std::string root;     // the html element's own tag
  std::string dom;      // the page as drawn, without its programs
  std::string console;  // what the browser complained of
};

Drawn Draw(const std::string& page, const fs::path& folder) {
  fs::create_directories(folder);
  std::ofstream(folder / "page.html", std::ios::binary) << page;
  // Virtual time: what the page does after loading is done before it is read.
  const std::string command = fmt::format(
      "HOME='{0}' timeout 200 '{1}' --headless --no-sandbox --disable-gpu --user-data-dir='{0}/profile' "
      "--enable-logging=stderr --virtual-time-budget=20000 --window-size=1280,900 --dump-dom "
      "'file://{0}/page.html' 2>'{0}/log' "
      ">'{0}/dom'",
      folder.string(), Chromium());
  const int status = std::system(command.c_str());
  const std::string log = Read(folder / "log");
  if (status != 0) ADD_FAILURE() << "the browser ended with " << status << ": " << log;
  Drawn drawn;
  drawn.dom = WithoutScripts(Read(folder / "dom"));
  const std::size_t root = drawn.dom.find("<html");
  if (root != std::string::npos) drawn.root = drawn.dom.substr(root, drawn.dom.find('>', root) - root);
  if (log.find("CONSOLE") != std::string::npos) drawn.console = log.substr(log.find("CONSOLE"), 600);
  return drawn;
}

// A browser draws the page: no error on its console, every part present, no text of the data run as a script.
TEST(ReportPage, DrawsItselfInABrowser) {
  if (Chromium().empty()) GTEST_SKIP() << "no chromium here: Debian's package chromium has it";
  const Folder folder;
  for (const Diagnosis& d :
       {ExampleDiagnosis(Verdict::kInsufficientData), Hostile(), Undefined(), Empty(), Pair(), Worse()}) {
    SCOPED_TRACE(VerdictName(d.verdict) + ": " + d.sentence.substr(0, 60));
    const Drawn drawn = Draw(ReportPage(d), folder.path());
    EXPECT_EQ(drawn.console, "");
    EXPECT_THAT(drawn.root, HasSubstr("data-charts="));
    EXPECT_THAT(drawn.root, Not(HasSubstr("data-problems")));
    EXPECT_THAT(drawn.root, Not(HasSubstr("data-hurt")));
    std::vector<std::string> parts{"where", "cause", "health", "provenance"};
    if (!d.overlays.empty()) parts.insert(parts.end(), {"closed", "runs", "conditions", "loops", "growth"});
    if (!d.confusable.empty()) parts.push_back("rivals");
    if (!d.next.family.empty()) parts.push_back("next");
    if (!d.degradations.empty()) parts.push_back("limits");
    for (const std::string& part : parts) {
      EXPECT_NE(drawn.dom.find("<section id=\"" + part + "\">"), std::string::npos)
          << part << " is not there";
    }
    const std::size_t nan = drawn.dom.find("NaN");
    if (nan != std::string::npos)
      ADD_FAILURE() << drawn.dom.substr(std::max<std::size_t>(nan, 200) - 200, 300);
  }
}

// A script in the page operates it as a reader does and writes the results where the test reads them.
constexpr const char* kReader = R"js(<script>{
const fire = (target, type, x, y) => target.dispatchEvent(
    new MouseEvent(type, {bubbles: true, cancelable: true, view: window, clientX: x, clientY: y, button: 0}));
const count = selector => document.querySelectorAll(selector).length;
const said = [];
let before = count('#cause .bar');
document.querySelector('#cause .controls button').click();
said.push(count('#cause .bar') > before ? 'all causes' : '');
before = count('#conditions svg');
document.querySelector('#conditions .controls button').click();
said.push(count('#conditions svg') > before ? 'all maps' : '');
const brush = () => document.querySelector('#runs .brush .overlay');
const box = brush().getBoundingClientRect();
const axis = () => document.querySelector('#runs .axis').textContent;
const whole = axis();
fire(brush(), 'mousedown', box.left + 200, box.top + 50);
fire(window, 'mousemove', box.left + 300, box.top + 50);
fire(window, 'mouseup', box.left + 300, box.top + 50);
said.push(axis() !== whole ? 'zoomed' : '');
fire(brush(), 'mousemove', box.left + 100, box.top + 50);
said.push(/measured .* N/.test(document.getElementById('tip').textContent) ? 'values' : '');
fire(brush(), 'dblclick', box.left + 100, box.top + 50);
said.push(axis() === whole ? 'whole' : '');
for (const s of document.querySelectorAll('#runs select')) {
  s.selectedIndex = s.options.length - 1;
  s.dispatchEvent(new Event('change'));
}
said.push(document.querySelector('#runs .axis-label').textContent);
window.dispatchEvent(new Event('beforeprint'));
window.dispatchEvent(new Event('afterprint'));
document.documentElement.dataset.said = said.join(', ');
}</script></body>)js";

TEST(ReportPage, AnswersItsReader) {
  if (Chromium().empty()) GTEST_SKIP() << "no chromium here: Debian's package chromium has it";
  const Folder folder;
  std::string page = ReportPage(ExampleDiagnosis(Verdict::kAttributed));
  page.replace(page.rfind("</body>"), 7, kReader);
  const Drawn drawn = Draw(page, folder.path());
  EXPECT_THAT(drawn.root, HasSubstr("data-said=\"all causes, all maps, zoomed, values, whole, tip z [mm]\""));
  EXPECT_THAT(drawn.root, Not(HasSubstr("data-problems")));
  EXPECT_EQ(drawn.console, "");
}

// Every figure as files, with its text, no part without content, the same text for the same number.
constexpr const char* kInspector = R"js(<script>(async () => {
const root = document.documentElement, said = {files: '', outside: '', empty: '', words: ''};
const made = {}, texts = [];
HTMLAnchorElement.prototype.click = function () {
  const [, type, data] = /^data:([^;,]*)[^,]*,(.*)$/.exec(this.href);
  made[type] = (made[type] || 0) + (data.length > 20 && this.download ? 1 : 0);
  if (type !== 'image/png') texts.push(decodeURIComponent(data));
};
const figures = document.querySelectorAll('.plot svg').length;
for (const button of document.querySelectorAll('.files button')) button.click();
for (let i = 0; i < 200 && (made['image/png'] || 0) < figures; ++i) await new Promise(r => setTimeout(r, 20));
const sound = texts.every(t => t.startsWith('<svg') ? !t.includes('var(--') && !new DOMParser().parseFromString(t, 'image/svg+xml').querySelector('parsererror') : t.split('\n').length > 2);
said.files = [figures > 8, made['image/png'] === figures, made['image/svg+xml'] === figures, made['text/csv'] === figures, sound].join(' ');
for (const svg of document.querySelectorAll('.plot svg')) {
  const frame = svg.getBoundingClientRect();
  for (const text of svg.querySelectorAll('text')) {
    const box = text.getBoundingClientRect();
    if (box.width && (box.left < frame.left - 1 || box.right > frame.right + 1 || box.top < frame.top - 1 || box.bottom > frame.bottom + 1)) said.outside += text.textContent + '; ';
  }
}
for (const s of document.querySelectorAll('section')) if (!s.querySelector('svg *, td, li, pre, p:not(.caption)')) said.empty += s.id + ' ';
const {percent, show} = window.reportWords;
said.words = [0, .004, .006, .99, .994, .996, 1, -.42].map(percent).join('|') + '|' + [[3.14159e-4, 'm'], [.02, 'rad'], [-.012, 'N'], [.3, 'N·m'], [1234567, 'Pa']].map(a => show(...a)).join('|');
Object.assign(root.dataset, said);
root.dataset.notes = [...document.querySelectorAll('#health .info')].every(e => e.closest('details') && !e.closest('details').open);
root.dataset.ceiling = /ceiling/i.test(document.getElementById('main').textContent);
root.dataset.copy = [...document.querySelectorAll('#next .command')].map(e => e.querySelector('pre').textContent + '+' + e.querySelector('button').textContent).join('|');
})();</script></body>)js";

TEST(ReportPage, GivesItsFiguresAsFilesAndKeepsItsWordsInside) {
  if (Chromium().empty()) GTEST_SKIP() << "no chromium here: Debian's package chromium has it";
  const Folder folder;
  Diagnosis d = ExampleDiagnosis(Verdict::kAmbiguousGroup);
  d.location.back().quantity = "tension, common to C2 and C3 of all tendons";
  d.next_commands = {"tendril excite --live --plan out/next.yaml"};
  d.health.push_back({HealthFinding::Severity::kInfo, "run", "", 3, "3 gaps were bridged."});
  std::string page = ReportPage(d);
  page.replace(page.rfind("</body>"), 7, kInspector);
  const Drawn drawn = Draw(page, folder.path());
  EXPECT_THAT(drawn.root, HasSubstr("data-files=\"true true true true true\""));
  EXPECT_THAT(drawn.root, HasSubstr("data-outside=\"\""));
  EXPECT_THAT(drawn.root, HasSubstr("data-empty=\"\""));
  EXPECT_THAT(drawn.root, HasSubstr("data-notes=\"true\""));
  EXPECT_THAT(drawn.root, HasSubstr("data-ceiling=\"false\""));
  EXPECT_THAT(drawn.root, HasSubstr("data-copy=\"tendril excite --live --plan out/next.yaml+Copy\""));
  std::string words;
  for (const double share : {0.0, .004, .006, .99, .994, .996, 1.0, -.42}) words += Percent(share) + "|";
  for (const auto& [v, unit] : std::initializer_list<std::pair<double, const char*>>{
           {3.14159e-4, "m"}, {.02, "rad"}, {-.012, "N"}, {.3, "N·m"}, {1234567, "Pa"}})
    words += WithUnit(v, unit) + "|";
  words.pop_back();
  // As markup, and with the sign that a page has for it.
  words = std::regex_replace(std::regex_replace(words, std::regex("<"), "&lt;"), std::regex(">"), "&gt;");
  words = std::regex_replace(words, std::regex("-"), "−");
  EXPECT_THAT(
      std::regex_replace(std::regex_replace(drawn.root, std::regex("&lt;"), "<"), std::regex("<"), "&lt;"),
      HasSubstr(words));
  EXPECT_THAT(drawn.root, Not(HasSubstr("data-problems")));
  EXPECT_EQ(drawn.console, "");
}

TEST(WriteReport, LeavesBothFilesAndSaysWhenItCannot) {
  const Folder folder;
  const Diagnosis d = ExampleDiagnosis(Verdict::kNoGap);
  WriteReport(d, folder.path() / "a" / "b");
  EXPECT_EQ(Read(folder.path() / "a" / "b" / "report.json"), ReportJson(d));
  EXPECT_EQ(Read(folder.path() / "a" / "b" / "report.html"), ReportPage(d));
  std::ofstream(folder.path() / "file") << "x";
  EXPECT_THROW(WriteReport(d, folder.path() / "file"), std::runtime_error);
}

// ---- summary ----------------------------------------------------------------------------------------------

int Columns(const std::string& line) {
  return static_cast<int>(std::count_if(
      line.begin(), line.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0) != 0x80; }));
}

TEST(Summary, FitsTheTerminalAndCannotSteerIt) {
  for (const Diagnosis& d : All()) {
    const std::string text = Summary(d, "out/gap/report.html");
    EXPECT_THAT(text, Not(HasSubstr("\x1b")));
    EXPECT_THAT(text, Not(HasSubstr("\r")));
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);) {
      if (line.find("document.") != std::string::npos) continue;  // one word, longer than a line
      EXPECT_LE(Columns(line), 100) << line;
    }
    EXPECT_THAT(text, HasSubstr("Report: out/gap/report.html\n"));
  }
  EXPECT_THAT(Summary(ExampleDiagnosis(Verdict::kAttributed), {}, true), HasSubstr("\x1b[1m"));
}

TEST(Summary, SaysWhereWhatHowFarAndWhatNext) {
  const std::string text = Summary(ExampleDiagnosis(Verdict::kAmbiguousGroup));
  EXPECT_THAT(text, testing::ContainsRegex("C2 drivetrain .*5.* sigma.*<- starts here"));
  EXPECT_THAT(text, testing::ContainsRegex("capstan_alpha +#+\\.+ +52 %  scale × 1.31 \\[1.22, 1.40\\]"));
  EXPECT_THAT(text, HasSubstr("no gap"));
  EXPECT_THAT(text, HasSubstr("unknown"));
  EXPECT_THAT(text, HasSubstr("Closed 88 % of the gap"));
  EXPECT_THAT(text, HasSubstr("mm"));
  EXPECT_THAT(text, HasSubstr("Next: reversals_three_tensions"));
  EXPECT_THAT(text, Not(HasSubstr("Report:")));
}

TEST(Summary, GivesTheCommandsToRunNextWhole) {
  Diagnosis d = ExampleDiagnosis(Verdict::kAttributed);
  d.next_commands = {"tendril gap apply --robot a.yaml " + std::string(120, 'x') +
                     "/report.json --out b.yaml"};
  EXPECT_THAT(Summary(d), HasSubstr("\nTo run next\n  " + d.next_commands[0] + "\n"));
  d.next_commands.clear();
  EXPECT_THAT(Summary(d), Not(HasSubstr("To run next")));
}

// Stamps that are exact, but for those that are lost.
TEST(Summary, SaysWhatTheClocksLack) {
  Diagnosis d = ExampleDiagnosis(Verdict::kNoGap);
  d.location[0].excess = true;
  d.location[0].excess_sigma = 0;
  d.location[0].note = "392 of 9001 samples lost";
  EXPECT_THAT(Summary(d), testing::ContainsRegex("C0 clocks .*392 of 9001 samples lost"));
}

// A cause with several components is named with all of them, each with its interval.
TEST(Summary, GivesEveryComponentOfACauseWhole) {
  Diagnosis d = ExampleDiagnosis(Verdict::kAttributed);
  Cause cause;
  cause.effect = "tip_force", cause.where = "all", cause.p = 0.97;
  cause.parameters = {{"x_N", {0.0293, 0.0275, 0.0311}},
                      {"y_N", {-0.0195, -0.021, -0.018}},
                      {"z_N", {0.0042, 0.0011, 0.0073}}};
  d.causes = d.accepted = {cause};
  const std::string text = Summary(d);
  for (const auto& [name, e] : cause.parameters) EXPECT_THAT(text, HasSubstr(ParameterWords(name, e, true)));
  const std::string sentence = Sentence(d, {}, "");
  for (const auto& [name, e] : cause.parameters) {
    EXPECT_THAT(sentence, HasSubstr(ParameterWords(name, e, false)));
  }
}

TEST(Summary, NamesEveryPlaceOfACut) {
  Diagnosis d = ExampleDiagnosis(Verdict::kAttributed);
  CutFinding found = d.location.front();
  found.cut = sim::Cut::kTendon, found.measured = found.excess = true, found.excess_sigma = 9;
  d.location.clear();
  for (const int j : {1, 3, 4, 5, 6}) {
    found.where = "tendon:" + std::to_string(j);
    d.location.push_back(found);
  }
  EXPECT_THAT(Summary(d), HasSubstr("tendons 1, 3 to 6"));
}

TEST(Wrapped, KeepsEveryWord) {
  const std::string text = Wrapped("one two\tthree\nfour \xc3\xa4\xc3\xb6\xc3\xbc", 4);
  EXPECT_EQ(text, "    one two three four äöü\n");
  std::string many;
  for (int i = 0; i < 100; ++i) many += "word ";
  std::istringstream lines(Wrapped(many, 2));
  int words = 0;
  for (std::string line; std::getline(lines, line);) {
    EXPECT_LE(line.size(), 100u);
    words += Count(line, "word");
  }
  EXPECT_EQ(words, 100);
}

}  // namespace
}  // namespace tendril::gap
