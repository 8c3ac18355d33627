// `tendril gap diagnose` as a user runs it, on incomplete or damaged folders: the planted gap is found with
// the remaining data, missing data are named, and data that cannot be used get one line.
#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>
#include <set>

#include "cli.h"
#include "tendril/sim/effects.h"

namespace tendril {
namespace {

using nlohmann::json;
using testing::ContainsRegex;
using testing::HasSubstr;

/// A CSV as its cells.
struct Table {
  std::vector<std::string> head;
  std::vector<std::vector<std::string>> rows;

  std::size_t Column(const std::string& name) const {
    for (std::size_t i = 0; i < head.size(); ++i) {
      if (head[i] == name) return i;
    }
    throw std::runtime_error("no column " + name);
  }
};

std::vector<std::string> Split(const std::string& line) {
  std::vector<std::string> cells(1);
  for (const char c : line) {
    if (c == ',') {
      cells.emplace_back();
    } else {
      cells.back() += c;
    }
  }
  return cells;
}

Table ReadTable(const fs::path& path) {
  std::istringstream lines(ReadText(path));
  Table table;
  std::string line;
  std::getline(lines, line);
  table.head = Split(line);
  while (std::getline(lines, line)) table.rows.push_back(Split(line));
  return table;
}

void WriteTable(const fs::path& path, const Table& table) {
  std::string text;
  const auto add = [&text](const std::vector<std::string>& cells) {
    for (std::size_t i = 0; i < cells.size(); ++i) text += (i ? "," : "") + cells[i];
    text += '\n';
  };
  add(table.head);
  for (const auto& row : table.rows) add(row);
  WriteText(path, text);
}

class DiagnoseCommandTest : public CommandTest {
 protected:
  // The motors make 20 % less torque than they report.
  void SetUp() override {
    CommandTest::SetUp();
    WriteText(folder_ / "plan.yaml",
              "runs:\n"
              "  - {family: circle, duration_s: 3, repeats: 1}\n"
              "  - {family: triangle, duration_s: 4}\n"
              "  - {family: multisine, duration_s: 3}\n");
    ASSERT_EQ(Run(fmt::format(
                  "gap simulate --robot {} --plan plan.yaml --effect 'torque_constant scale=0.8' --out set "
                  "--seed 9 --jobs 1",
                  kRig)),
              0)
        << error_;
    // A library that is small enough to be searched in a second.
    const std::set<std::string_view> kept{"torque_constant",  "motor_coulomb", "bending_stiffness",
                                          "tendon_stiffness", "cell_gain",     "tracker_delay",
                                          "command_delay"};
    for (const sim::Effect& effect : sim::Effects()) {
      if (!kept.count(effect.name)) small_ += fmt::format(" --without {}", effect.name);
    }
  }

  int Diagnose(const std::string& more = "", const std::string& robot = kRig) {
    fs::remove_all(folder_ / "report");
    const int code =
        Run(fmt::format("gap diagnose --robot {} set --out report --no-next --threads 1 --refits 2{} {}",
                        robot, small_, more));
    report_ = fs::exists(folder_ / "report/report.json")
                  ? json::parse(ReadText(folder_ / "report/report.json"))
                  : json();
    return code;
  }
  /// Diagnosed, and the planted cause is the first one.
  testing::AssertionResult Found() {
    const int code = Diagnose();
    if (code != 0) return testing::AssertionFailure() << "exit " << code << ": " << error_;
    const json& top = report_["causes"][0];
    if (top["effect"] != "torque_constant") {
      return testing::AssertionFailure() << report_["sentence"] << " first cause " << top["effect"];
    }
    const double scale = top["parameters"]["scale"]["value"];
    if (std::abs(scale - 0.8) > 0.05) return testing::AssertionFailure() << "scale " << scale;
    return testing::AssertionSuccess();
  }
  void Edit(const std::function<void(Table&)>& edit, const std::string& only = "") {
    for (const auto& entry : fs::directory_iterator(folder_ / "set")) {
      if (entry.path().extension() != ".csv") continue;
      if (!only.empty() && entry.path().filename() != only) continue;
      Table table = ReadTable(entry.path());
      edit(table);
      WriteTable(entry.path(), table);
    }
  }
  static void Scale(Table& table, const std::string& prefix, double factor) {
    for (std::size_t i = 0; i < table.head.size(); ++i) {
      if (!table.head[i].starts_with(prefix)) continue;
      for (auto& row : table.rows) {
        if (!row[i].empty()) row[i] = fmt::format("{}", std::stod(row[i]) * factor);
      }
    }
  }
  static void Drop(Table& table, const std::string& prefix) {
    for (std::size_t i = table.head.size(); i-- > 0;) {
      if (!table.head[i].starts_with(prefix)) continue;
      table.head.erase(table.head.begin() + static_cast<std::ptrdiff_t>(i));
      for (auto& row : table.rows) row.erase(row.begin() + static_cast<std::ptrdiff_t>(i));
    }
  }
  /// Everything that the report says about the data, line by line.
  std::string Said() const {
    std::string text;
    if (report_.is_null()) return text;
    for (const json& line : report_["degradations"]) text += line.get<std::string>() + "\n";
    for (const json& h : report_["data_health"]) {
      text += fmt::format("{} {} {}: {}\n", h["severity"].get<std::string>(), h["run"].get<std::string>(),
                          h["channel"].get<std::string>(), h["text"].get<std::string>());
    }
    return text;
  }
  /// Fails with one line and leaves no report.
  testing::AssertionResult Refused(const std::string& more = "", const std::string& robot = kRig) {
    if (const int got = Diagnose(more, robot); got != 1)
      return testing::AssertionFailure() << "exit " << got << ": " << error_;
    if (!report_.is_null()) return testing::AssertionFailure() << "a report was written";
    // Progress may precede it, and one line for each file that was left out may follow it.
    const auto at = error_.rfind("tendril: ");
    if (at == std::string::npos) return testing::AssertionFailure() << error_;
    std::istringstream lines(error_.substr(at));
    std::string line;
    std::getline(lines, line);
    while (std::getline(lines, line)) {
      if (!line.starts_with("  left out: ")) return testing::AssertionFailure() << error_;
    }
    return testing::AssertionSuccess();
  }

  std::string small_;
  json report_;
};

TEST_F(DiagnoseCommandTest, WholeSetsAreDiagnosed) {
  ASSERT_TRUE(Found());
  EXPECT_EQ(report_["verdict"], "attributed");
  EXPECT_THAT(out_, HasSubstr("torque_constant"));
  EXPECT_TRUE(fs::exists(folder_ / "report/report.html"));
  // The same report again, bit for bit except for its duration.
  json first = report_;
  ASSERT_EQ(Diagnose(), 0);
  first["provenance"].erase("seconds");
  report_["provenance"].erase("seconds");
  EXPECT_EQ(first, report_);
  // The whole command, quoted so that a shell can run it again.
  EXPECT_EQ(report_["provenance"]["command"],
            fmt::format("tendril gap diagnose --robot {} set --out report --no-next --threads 1 --refits 2{}",
                        kRig, small_));
  fs::copy_file(kRig, folder_ / "it's a rig.yaml");
  ASSERT_EQ(Diagnose("--seed 7 --delta-mm=0.5", "\"it's a rig.yaml\""), 0) << error_;
  const std::string command = report_["provenance"]["command"];
  EXPECT_TRUE(command.starts_with("tendril gap diagnose --robot 'it'\\''s a rig.yaml' set --out report"));
  EXPECT_TRUE(command.ends_with(" --seed 7 --delta-mm=0.5")) << command;
}

TEST_F(DiagnoseCommandTest, AMissingRunIsLeftOutAndReported) {
  fs::remove(folder_ / "set/04_multisine.csv");
  ASSERT_TRUE(Found());
  EXPECT_THAT(Said(), HasSubstr("left out: cannot read set/04_multisine.csv"));
}

TEST_F(DiagnoseCommandTest, ValuesThatAreNotNumbersAreReportedAsGaps) {
  Edit(
      [](Table& table) {
        for (std::size_t i = 1000; i < 1400; ++i) table.rows[i][table.Column("tension_N_2")] = "nan";
        for (std::size_t i = 500; i < 520; ++i) table.rows[i][table.Column("motor_position_rad_1")] = "inf";
      },
      "03_triangle.csv");
  ASSERT_TRUE(Found());
  EXPECT_THAT(Said(), HasSubstr("03_triangle tension 2: 10.0 % of its values are missing"));
}

TEST_F(DiagnoseCommandTest, FilesWithoutAnyNumberAreRefused) {
  Edit([](Table& table) {
    for (auto& row : table.rows) {
      for (std::size_t i = 1; i < row.size(); ++i) row[i] = "nan";
    }
  });
  EXPECT_TRUE(Refused());
}

TEST_F(DiagnoseCommandTest, ATruncatedFileIsUsedUpToItsEndAndReported) {
  const std::string text = ReadText(folder_ / "set/03_triangle.csv");
  WriteText(folder_ / "set/03_triangle.csv", text.substr(0, text.size() * 2 / 3));
  ASSERT_TRUE(Found());
  EXPECT_THAT(Said(),
              ContainsRegex("03_triangle file: set/03_triangle.csv:[0-9]+: the last line has no line end"));
}

TEST_F(DiagnoseCommandTest, EmptyFilesAndTextAreNamed) {
  WriteText(folder_ / "set/04_multisine.csv", "");
  Edit([](Table& table) { table.rows[100][3] = "abc"; }, "03_triangle.csv");
  ASSERT_EQ(Diagnose(), 0) << error_;
  EXPECT_THAT(Said(), ContainsRegex("04_multisine.csv"));
  EXPECT_THAT(Said(), ContainsRegex("03_triangle.csv:102: .*abc"));
  WriteText(folder_ / "set/01_circle.csv", "t_s\n");
  WriteText(folder_ / "set/02_circle.csv", "hello\nworld\n");
  WriteText(folder_ / "set/03_triangle.csv", "\xff\xfe\x00junk");
  EXPECT_TRUE(Refused());
}

TEST_F(DiagnoseCommandTest, WrongUnitsAreReportedWithAHint) {
  const struct {
    const char* column;
    double factor;
    const char* hint;
  } cases[] = {
      {"tip_x_m", 1e3, "millimetres"},
      {"motor_position_rad", 57.29578, "degrees"},
      {"torque_actual_Nm", 1e3, "millinewton metres"},
  };
  // Half of the rows are enough, and take half the time.
  Edit([](Table& table) {
    std::vector<std::vector<std::string>> rows;
    for (std::size_t i = 0; i < table.rows.size(); i += 2) rows.push_back(table.rows[i]);
    table.rows = std::move(rows);
  });
  const fs::path kept = folder_ / "kept";
  fs::copy(folder_ / "set", kept);
  for (const auto& c : cases) {
    fs::remove_all(folder_ / "set");
    fs::copy(kept, folder_ / "set");
    Edit([&c](Table& table) {
      Scale(table, c.column, c.factor);
      if (std::string(c.column) == "tip_x_m") {
        Scale(table, "tip_y_m", c.factor);
        Scale(table, "tip_z_m", c.factor);
      }
    });
    const int code = Diagnose();
    // Printed before the search begins, and in the report.
    EXPECT_THAT(error_, ContainsRegex(fmt::format("warning: [^\n]*{}", c.hint)))
        << c.column << " exit " << code;
    EXPECT_TRUE(code == 0 || code == 1) << code;
    if (code == 0) {
      EXPECT_THAT(Said(), HasSubstr(c.hint));
      if (std::string(c.column) == "tip_x_m") {
        // The tip is left out with a note, and a cause at an earlier cut is found.
        EXPECT_EQ(report_["verdict"], "attributed") << report_["sentence"];
        EXPECT_EQ(report_["causes"][0]["effect"], "torque_constant");
        EXPECT_NEAR(report_["causes"][0]["parameters"]["scale"]["value"].get<double>(), 0.8, 0.05);
        EXPECT_THAT(Said(), ContainsRegex("tip [xyz] reaches [^\n]* of its values: left out"));
      } else {
        EXPECT_NE(report_["verdict"], "attributed") << c.column;
      }
    }
  }
}

TEST_F(DiagnoseCommandTest, TheFileOfAnotherRobotIsRefused) {
  const std::string robots = TENDRIL_SOURCE_DIR "/config/robots/";
  EXPECT_TRUE(Refused("", robots + "rig_60mm.yaml"));
  EXPECT_THAT(error_, HasSubstr("set/robot.yaml: these runs are of another robot"));
  EXPECT_THAT(error_, HasSubstr("name is rig_90mm there, rig_60mm in the file"));
  EXPECT_THAT(error_, HasSubstr("0.09 m there, 0.06 m in the file"));
  EXPECT_TRUE(Refused("", robots + "four_tendon_90mm.yaml"));
  EXPECT_THAT(error_, HasSubstr("tendons is 3 there, 4 in the file"));
  EXPECT_TRUE(Refused("--same-robot", robots + "qi2021_90mm.yaml"));
  EXPECT_THAT(error_, HasSubstr("actuation"));
  EXPECT_TRUE(Refused("", TENDRIL_SOURCE_DIR "/config/tendrild.yaml"));
  EXPECT_THAT(error_, HasSubstr("tendrild.yaml"));
}

// Where a set does not name its robot, the tip's path shows a mismatch.
TEST_F(DiagnoseCommandTest, ATipPathThatTheRobotIsTooShortForIsTheVerdict) {
  WriteText(folder_ / "wide.yaml", "runs:\n  - {family: circle, duration_s: 7, amplitude_rad: 1.5}\n");
  ASSERT_EQ(Run(fmt::format("gap simulate --robot {} --plan wide.yaml --out set --overwrite", kRig)), 0)
      << error_;
  fs::remove(folder_ / "set/robot.yaml");
  ASSERT_EQ(Diagnose("", TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml"), 0) << error_;
  EXPECT_EQ(report_["verdict"], "unexplained");
  EXPECT_THAT(report_["sentence"].get<std::string>(),
              testing::StartsWith("No pose of robot 'rig_60mm' explains the recorded tip path"));
  EXPECT_TRUE(report_["accepted"].empty());
}

TEST_F(DiagnoseCommandTest, AConstantChannelIsReported) {
  Edit([](Table& table) {
    for (auto& row : table.rows) row[table.Column("tension_N_3")] = "0.3";
  });
  ASSERT_EQ(Diagnose(), 0) << error_;
  EXPECT_THAT(Said(), HasSubstr("tension 3: is 0.3 N throughout"));
}

TEST_F(DiagnoseCommandTest, AClippedChannelIsReported) {
  Edit([](Table& table) {
    for (auto& row : table.rows) {
      std::string& cell = row[table.Column("tension_N_1")];
      if (!cell.empty() && std::stod(cell) > 1.5) cell = "1.5";
    }
  });
  ASSERT_EQ(Diagnose(), 0) << error_;
  EXPECT_THAT(Said(), ContainsRegex("tension 1: is clipped at 1.5 N for"));
  EXPECT_EQ(report_["causes"][0]["effect"], "torque_constant") << report_["sentence"];
  EXPECT_EQ(report_["verdict"], "attributed") << "what was cut off is no cause: " << report_["sentence"];
}

TEST_F(DiagnoseCommandTest, AFailedDiagnosisLeavesNoReportFolder) {
  fs::create_directory(folder_ / "empty");
  const auto refused = [&](const std::string& out) {
    return Run("gap diagnose --robot set/robot.yaml empty --out " + out);
  };
  EXPECT_EQ(refused("new"), 1);
  EXPECT_THAT(error_, HasSubstr("no usable run"));
  EXPECT_FALSE(fs::exists(folder_ / "new"));
  fs::create_directory(folder_ / "there");
  EXPECT_EQ(refused("there"), 1);
  EXPECT_TRUE(fs::exists(folder_ / "there")) << "somebody else's";
}

TEST_F(DiagnoseCommandTest, ASingleRunIsDiagnosedWithFewerStatements) {
  for (const char* name : {"01_circle", "02_circle", "04_multisine"})
    fs::remove(folder_ / "set" / (std::string(name) + ".csv"));
  WriteText(folder_ / "set/runs.yaml", "runs:\n  - {file: 03_triangle.csv, family: triangle}\n");
  ASSERT_EQ(Diagnose(), 0) << error_;
  EXPECT_EQ(report_["causes"][0]["effect"], "torque_constant") << report_["sentence"];
  EXPECT_THAT(Said(), HasSubstr("no repeated runs"));
  EXPECT_THAT(Said(), HasSubstr("one family"));
}

TEST_F(DiagnoseCommandTest, WithoutRepetitionsTheFloorIsFromFastDifferences) {
  std::string runs = ReadText(folder_ / "set/runs.yaml");
  const std::string repeat = "repeat_of: 01_circle.csv";
  ASSERT_NE(runs.find(repeat), std::string::npos);
  WriteText(folder_ / "set/runs.yaml", runs.replace(runs.find(repeat), repeat.size(), "repeat_of: none"));
  ASSERT_TRUE(Found());
  EXPECT_THAT(Said(), HasSubstr("no repeated runs: the noise floor comes from high-frequency differences"));
}

TEST_F(DiagnoseCommandTest, WithoutATrackerTheBodyIsNotSeen) {
  Edit([](Table& table) { Drop(table, "tip_"); });
  ASSERT_TRUE(Found());
  EXPECT_THAT(Said(), HasSubstr("no tracker: shape and motion (C4, C5) are not seen"));
}

TEST_F(DiagnoseCommandTest, WithoutLoadCellsPlacesCannotBeToldApart) {
  Edit([](Table& table) { Drop(table, "tension_N"); });
  ASSERT_EQ(Diagnose(), 0) << error_;
  EXPECT_THAT(Said(), HasSubstr("no load cell: the tensions on the body are taken from the motors"));
  EXPECT_EQ(report_["causes"][0]["effect"], "torque_constant") << report_["sentence"];
}

TEST_F(DiagnoseCommandTest, RunsWithoutMotorPositionsAndTensionsAreRefused) {
  Edit([](Table& table) {
    Drop(table, "motor_position");
    Drop(table, "tension_N");
  });
  EXPECT_TRUE(Refused());
  EXPECT_THAT(error_, HasSubstr("motor positions of every tendon"));
}

TEST_F(DiagnoseCommandTest, AnEmptyChannelIsReported) {
  Edit([](Table& table) {
    for (auto& row : table.rows) row[table.Column("tension_N_3")] = "nan";
  });
  ASSERT_TRUE(Found());
  EXPECT_THAT(Said(), HasSubstr("tension 3: has no value at all"));
  EXPECT_THAT(Said(), HasSubstr("the load cell of tendon 3 has no data"));
}

TEST_F(DiagnoseCommandTest, WithoutALoadCellATendonsTensionComesFromItsStretch) {
  Edit([](Table& table) {
    for (auto& row : table.rows) row[table.Column("tension_N_3")].clear();
  });
  ASSERT_TRUE(Found());
  EXPECT_THAT(Said(), ContainsRegex(
                          "the load cell of tendon 3 has no data, or readings .*: the tension is taken from "
                          "the motor and the tendon's stretch"));
}

TEST_F(DiagnoseCommandTest, SlowLogsAreDiagnosedAndReported) {
  Edit([](Table& table) {
    std::vector<std::vector<std::string>> kept;
    for (std::size_t i = 0; i < table.rows.size(); i += 20) kept.push_back(table.rows[i]);
    table.rows = kept;
  });
  ASSERT_TRUE(Found());
  EXPECT_THAT(Said(), HasSubstr("50 Hz; drives (C1) and motion (C5) need 100 Hz or more"));
}

TEST_F(DiagnoseCommandTest, LogsOf100HzAreEnough) {
  Edit([](Table& table) {
    std::vector<std::vector<std::string>> kept;
    for (std::size_t i = 0; i < table.rows.size(); i += 10) kept.push_back(table.rows[i]);
    table.rows = kept;
  });
  ASSERT_TRUE(Found());
}

TEST_F(DiagnoseCommandTest, LostRowsAreReportedAsGaps) {
  Edit([](Table& table) {
    std::vector<std::vector<std::string>> kept;
    for (std::size_t i = 0; i < table.rows.size(); ++i) {
      if ((i < 800 || i > 812) && (i < 1500 || i > 1507)) kept.push_back(table.rows[i]);
    }
    table.rows = kept;
  });
  ASSERT_TRUE(Found());
  EXPECT_THAT(Said(), ContainsRegex("rows are missing in 2 gaps"));
}

TEST_F(DiagnoseCommandTest, ATrackerOnAnotherClockIsReportedWithItsOffset) {
  ASSERT_EQ(Run(fmt::format(
                "gap simulate --robot {} --plan plan.yaml --out set --overwrite --seed 10 --jobs 1", kRig)),
            0)
      << error_;
  Edit([](Table& table) {
    for (std::size_t i = 0; i < table.head.size(); ++i) {
      if (!table.head[i].starts_with("tip_")) continue;
      for (std::size_t r = table.rows.size(); r-- > 0;)
        table.rows[r][i] = r >= 60 ? table.rows[r - 60][i] : "";
    }
  });
  ASSERT_EQ(Diagnose(), 0) << error_;
  EXPECT_THAT(Said(),
              ContainsRegex("tracker clock: the tip follows the motors [67][0-9](\\.[0-9])? ms later"));
  ASSERT_FALSE(report_["accepted"].empty()) << report_["sentence"];
  EXPECT_EQ(report_["accepted"][0]["effect"], "tracker_delay");
  EXPECT_NEAR(report_["accepted"][0]["parameters"]["s"]["value"].get<double>(), 0.06, 0.002);
}

TEST_F(DiagnoseCommandTest, TimesThatGoBackAreNamed) {
  Edit([](Table& table) { table.rows[1000][0] = "0.5"; }, "03_triangle.csv");
  ASSERT_EQ(Diagnose(), 0) << error_;
  EXPECT_THAT(Said(), HasSubstr("1 rows whose time does not increase dropped, the first in line 1002"));
}

TEST_F(DiagnoseCommandTest, WrongUseIsReported) {
  EXPECT_EQ(Run("gap diagnose set"), 2);
  EXPECT_THAT(error_, HasSubstr("--robot"));
  EXPECT_EQ(Run(fmt::format("gap diagnose --robot {}", kRig)), 2);
  const struct {
    const char *arguments, *says;
  } cases[] = {
      {"--without gremlins", "--without: there is no effect 'gremlins'"},
      {"--only BACKLASH", "did you mean backlash?"},
      {"--only bendng", "did you mean bending_"},
      {"--seed -1", "leave out the sign"},
      {"--threads -1", "--threads"},
      {"--refits 0", "--refits"},
      {"--delta-N 0", "--delta-N"},
      {"--delta-mm nonsense", "--delta-mm"},
      {"--delta-mm -1", "'-1' is out of range; accepted: a number above 0"},
      {"--delta-mm inf", "'inf' is out of range"},
  };
  for (const auto& c : cases) {
    EXPECT_EQ(Run(fmt::format("gap diagnose --robot {} set {} --out report", kRig, c.arguments)), 2)
        << c.arguments;
    EXPECT_THAT(error_, HasSubstr(c.says));
    EXPECT_LT(error_.find('\n'), 200u) << error_;
  }
  EXPECT_EQ(Run(fmt::format("gap diagnose --robot {} gone --out report", kRig)), 1);
  EXPECT_THAT(error_, HasSubstr("gone: no such file or folder"));
  EXPECT_EQ(Run("gap diagnose --robot gone.yaml set --out report"), 1);
  EXPECT_THAT(error_, HasSubstr("gone.yaml"));
  EXPECT_EQ(Run(fmt::format("gap diagnose --robot {} set --daemon gone.yaml --out report", kRig)), 1);
  EXPECT_THAT(error_, HasSubstr("gone.yaml"));
}

}  // namespace
}  // namespace tendril
