// The forms in which programs write tables: each is read by options of the column map, and a refusal names
// the option that reads it. All forms of one table give the same run.
#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "tendril/config/config.h"
#include "tendril/gap/import.h"

namespace tendril::gap {
namespace {

namespace fs = std::filesystem;
using testing::Contains;
using testing::HasSubstr;

const std::string kColumns = "columns: {tension: {names: [a, b, null]}}\n";
const std::string kMap = "time: {column: t}\n" + kColumns;
const std::string kRows = "0,1.5,2\n0.01,1.25,-3\n0.02,0.5,1e-3\n";

class TableFormsTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("tendril_table_forms_test_" + std::to_string(getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    robot_ = config::LoadRobot(std::string(TENDRIL_SOURCE_DIR) + "/config/robots/rig_60mm.yaml");
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string Write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name, std::ios::binary) << text;
    return (folder_ / name).string();
  }
  gap::Run Import(const std::string& map, const std::string& table) const {
    return ImportTables(Write("map.yaml", map), {Write("table.csv", table)}, robot_).runs.at(0);
  }
  std::string Refusal(const std::string& map, const std::string& table) const {
    try {
      Import(map, table);
    } catch (const std::exception& e) {
      return e.what();
    }
    return "";
  }
  /// What kRows says.
  void ExpectRows(const std::string& map, const std::string& table) const {
    SCOPED_TRACE(map + table);
    gap::Run run;
    ASSERT_NO_THROW(run = Import(map, table)) << Refusal(map, table);
    ASSERT_EQ(run.time_s.size(), 3);
    EXPECT_TRUE(run.time_s.isApprox(Eigen::Vector3d(0, 0.01, 0.02), 1e-9)) << run.time_s;
    EXPECT_TRUE(run.tension_N.col(0).isApprox(Eigen::Vector3d(1.5, 1.25, 0.5), 1e-15));
    EXPECT_TRUE(run.tension_N.col(1).isApprox(Eigen::Vector3d(2, -3, 1e-3), 1e-15));
  }
  /// Refused with a line that names an option; the map with that option reads the table.
  void ExpectRemedy(const std::string& map, const std::string& table, const std::string& option) const {
    EXPECT_THAT(Refusal(map, table), HasSubstr("set " + option));
    ExpectRows(option + "\n" + map, table);
  }

  fs::path folder_;
  RobotParameters robot_;
};

TEST_F(TableFormsTest, ColumnsWithoutNamesAreCalledByTheirPlaces) {
  const std::string map = "time: {column: 1}\ncolumns: {tension: {names: [2, 3, null]}}\n";
  EXPECT_THAT(Refusal(kMap, kRows), HasSubstr("set table: {header: none}"));
  ExpectRows("table: {header: none}\n" + map, kRows);
  ExpectRows("table: {header: none}\n" + map, "# made by hand\n\n0;1,5;2\n0,01;1,25;-3\n0,02;0,5;1e-3\n");
  ExpectRows("table: {header: none}\n" + map, "0 1.5 2\n0.01 1.25  -3\n 0.02\t0.5 1e-3\n");
  ExpectRows("table: {header: none, skip_lines: 2}\n" + map, "Rig 7, run 3\nt,a,a\n" + kRows);
  EXPECT_THAT(
      Refusal("table: {header: none}\n" + map, "t,a,a\ns,N,N\n" + kRows),
      HasSubstr("table.csv:1: column 1: 't' is not a number; accepted: a number such as -0.0125, or an "
                "empty cell for no value; correct the cell or remove the line; if the lines before line 3 "
                "are not rows, set table: {skip_lines: 2} in the map"));
  EXPECT_THAT(Refusal("table: {header: none}\n" + map, "0,1\n1,2\n"),
              HasSubstr("no column '3', which the map"));
}

TEST_F(TableFormsTest, LinesBeforeTheNamesAreSkipped) {
  // As motion capture systems write them: rows with other numbers of cells, an empty line.
  ExpectRemedy(kMap, "Format Version,1.23,Take Name,Take 1\r\n\r\n,,Marker\r\nt,a,b\r\n" + kRows,
               "table: {skip_lines: 3}");
  ExpectRemedy(kMap, "Rig: 7; operator: nobody\nt,a,b\n" + kRows, "table: {skip_lines: 1}");
  ExpectRemedy(kMap, "sep=,\nt,a,b\n" + kRows, "table: {skip_lines: 1}");
  ExpectRemedy(kMap, "\xEF\xBB\xBFMade\ton\tMonday\n\"t\",\"a\",\"b\"\n" + kRows, "table: {skip_lines: 1}");
  EXPECT_THAT(Refusal("table: {skip_lines: 9}\n" + kMap, "t,a,b\n" + kRows),
              HasSubstr("the file ends within the 9 lines that table.skip_lines skips"));
}

TEST_F(TableFormsTest, CommentsBeginWithTheMapsCharacters) {
  ExpectRows(kMap, "# lab 3\n# 1000 Hz\nt,a,b\n" + kRows);
  ExpectRemedy(kMap, "% lab 3\n% 1000 Hz\nt,a,b\n" + kRows, "table: {comment: '%'}");
  ExpectRemedy(kMap, "; lab 3\nt,a,b\n" + kRows, "table: {comment: ';'}");
  ExpectRemedy(kMap, "t,a,b\n" + kRows.substr(0, 8) + "% paused here,,\n" + kRows.substr(8),
               "table: {comment: '%'}");
  ExpectRows("table: {comment: '#%;'}\n" + kMap, "% x\n; y\n# z\nt,a,b\n" + kRows);
  // Names within a comment, as numerical libraries write them.
  ExpectRemedy(kMap, "# t,a,b\n" + kRows, "table: {header: comment}");
  ExpectRemedy(kMap, "% lab 3\n%t a b\n0 1.5 2\n0.01 1.25 -3\n0.02 0.5 1e-3\n",
               "table: {header: comment, comment: '%'}");
  EXPECT_THAT(Refusal("table: {header: comment}\n" + kMap, "t,a,b\n" + kRows),
              HasSubstr("no comment before"));
  EXPECT_THAT(Refusal("table: {comment: ab}\n" + kMap, kRows), HasSubstr("'ab' cannot begin a comment"));
  EXPECT_THAT(Refusal("table: {comment: ';', delimiter: semicolon}\n" + kMap, kRows),
              HasSubstr("other than the delimiter"));
}

TEST_F(TableFormsTest, RowsOfUnitsAreSkippedAndRowsOfNumbersAreNot) {
  ExpectRemedy(kMap, "t,a,b\ns,N,N\n" + kRows, "table: {unit_rows: 1}");
  ExpectRemedy(kMap, "t\ta\tb\n[s]\t[N]\t[N]\nraw\traw\traw\n0\t1.5\t2\n0.01\t1.25\t-3\n0.02\t0.5\t1e-3\n",
               "table: {unit_rows: 2}");
  EXPECT_THAT(
      Refusal("table: {unit_rows: 2}\n" + kMap, "t,a,b\ns,N,N\n" + kRows),
      HasSubstr("table.csv:3: a row of numbers, which table.unit_rows: 2 would skip; accepted: unit_rows: "
                "1 for this table"));
  EXPECT_THAT(Refusal("table: {unit_rows: 1, header: none}\n" + kMap, kRows), HasSubstr("without names"));
  // A wrong number in the first row is an error as well.
  const std::string wrong = Refusal(kMap, "t,a,b\n0,1.2.3,2\n" + kRows.substr(8));
  EXPECT_THAT(wrong, HasSubstr("table.csv:2: column a: '1.2.3' is not a number"));
}

TEST_F(TableFormsTest, NamesMayHoldUnitsSpacesAndDelimiters) {
  ExpectRows("time: {column: 'Time (Seconds)'}\ncolumns: {tension: {names: ['Force [N]', 'F, 2', null]}}\n",
             "\"Time (Seconds)\",\"Force [N]\",\"F, 2\"\n" + kRows);
  EXPECT_THAT(
      Refusal("time: {column: Time}\n" + kColumns, "Time a b (N)\n0 1.5 2\n0.01 1.25 -3\n0.02 0.5 1e-3\n"),
      HasSubstr("set table: {header: none, skip_lines: 1}"));
}

TEST_F(TableFormsTest, TimesMayBeDates) {
  const std::string map = "time: {column: t, unit: iso8601}\n" + kColumns;
  const auto table = [](const char* t0, const char* t1, const char* t2) {
    return fmt::format("t,a,b\n{},1.5,2\n{},1.25,-3\n{},0.5,1e-3\n", t0, t1, t2);
  };
  const std::string plain =
      table("2024-05-01 12:00:00.000", "2024-05-01 12:00:00.010", "2024-05-01 12:00:00.020");
  EXPECT_THAT(Refusal(kMap, plain), HasSubstr("set time: {column: 't', unit: iso8601}"));
  ExpectRows(map, plain);
  ExpectRows(map, table("2024-12-31T23:59:59.99Z", "2025-01-01T00:00:00Z", "2025-01-01T00:00:00.010000000Z"));
  // Daylight saving begins between the first row and the second; the offsets show it.
  ExpectRows(map, table("2024-03-31T01:59:59.990+01:00", "2024-03-31T03:00:00+02:00",
                        "2024-03-31T03:00:00.01+0200"));
  // Leap days are days; 1900 had none, 2000 had one.
  EXPECT_EQ(Import(map, table("2000-02-28 00:00", "2000-03-01 00:00", "2001-03-01 00:00")).time_s,
            86400 * Eigen::Vector3d(0, 2, 367));
  EXPECT_EQ(Import(map, table("1900-02-28 00:00", "1900-03-01 00:00", "1970-01-01 00:00")).time_s,
            86400 * Eigen::Vector3d(0, 1, 25509));
  ExpectRows(map, table("2024-02-29T12:00:00-05", "2024-02-29T17:00:00.01Z", "2024-02-29T12:00:00.02-05"));
  ExpectRows(map, table("\"2024-05-01 12:00:00,000\"", "\"2024-05-01 12:00:00,010\"",
                        "\"2024-05-01 "
                        "12:00:00,020\""));
  EXPECT_THAT(
      Refusal(map, table("2024-05-01 12:00:00Z", "2024-05-01 12:00:01", "2024-05-01 12:00:02Z")),
      HasSubstr("table.csv:3: column t: '2024-05-01 12:00:01' is not a time; accepted: an offset from UTC"));
  for (const char* wrong : {"2023-02-29 12:00:00", "05/01/2024 12:00:00", "2024-05-01 24:30:00", "12.5",
                            "2024-05-01", "2024-05-01 12:00:00.", "2024-05-01 12:00:00 CET"}) {
    EXPECT_THAT(
        Refusal(map, table("2024-02-28 12:00:00", wrong, "2024-05-01 12:00:02")),
        HasSubstr(fmt::format("table.csv:3: column t: '{}' is not a time; accepted: such as", wrong)));
  }
}

TEST_F(TableFormsTest, TimesMayBeOfTheDayAndPassMidnight) {
  const std::string map = "time: {column: t, unit: clock}\n" + kColumns;
  const auto table = [](const char* t0, const char* t1, const char* t2) {
    return fmt::format("t,a,b\n{},1.5,2\n{},1.25,-3\n{},0.5,1e-3\n", t0, t1, t2);
  };
  EXPECT_THAT(Refusal(kMap, table("12:00:00.000", "12:00:00.010", "12:00:00.020")),
              HasSubstr("set time: {column: 't', unit: clock}"));
  ExpectRows(map, table("12:00:00.000", "12:00:00.010", "12:00:00.020"));
  ExpectRows(map, table("23:59:59.985", "23:59:59.995", "00:00:00.005"));
  EXPECT_THAT(Import(map, table("23:59:59.985", "23:59:59.995", "00:00:00.005")).notes,
              Contains(HasSubstr("passes midnight in line 4")));
  ExpectRows(map, table("11:59:59.99 AM", "12:00:00 PM", "12:00:00.01 PM"));
  ExpectRows(map, table("11:59:59.99 PM", "12:00:00 AM", "12:00:00.01 AM"));
  ExpectRows(map, table("99:59:59.99", "100:00:00.00", "100:00:00.01"));
  for (const char* wrong : {"12:00", "12:61:00", "12:00:00:05", "0.5", "noon"}) {
    EXPECT_THAT(Refusal(map, table("11:00:00", wrong, "12:30:00")),
                HasSubstr(fmt::format("'{}' is not a time; accepted: HH:MM:SS", wrong)));
  }
  // A row that goes back over midnight is out of order and dropped.
  const gap::Run back =
      Import(map, "t,a,b\n23:59:59,1,1\n00:00:01,2,2\n23:59:58,3,3\n00:00:02,4,4\n00:00:03,5,5\n");
  EXPECT_TRUE(back.time_s.isApprox(Eigen::Vector4d(0, 2, 3, 4), 1e-9));
}

// Which of the two columns applies is unknown.
TEST_F(TableFormsTest, AColumnThatIsThereTwiceIsRefused) {
  const std::string table = "t,a,b,c,a\n0,1,2,3,4\n1,1,2,3,4\n";
  const std::string refusal = Refusal(kMap, table);
  EXPECT_THAT(refusal, HasSubstr("table.csv:1: columns 2 and 5 are both called 'a'"));
  EXPECT_THAT(refusal, HasSubstr("set table: {header: none, skip_lines: 1}"));
  const gap::Run run = Import(
      "table: {header: none, skip_lines: 1}\ntime: {column: 1}\ncolumns: {tension: {names: [5, 3, 2]}}\n",
      table);
  EXPECT_TRUE(run.tension_N.row(0).isApprox(Eigen::RowVector3d(4, 2, 1)));
  // Other duplicate columns do not matter.
  EXPECT_EQ(Refusal("time: {column: t}\ncolumns: {tension: {names: [b, c, null]}}\n", table), "");
  // Canonical tables, whose names are case-insensitive.
  Write("twice.csv", "t_s,tension_N_1,x,x,Tension_n_1\n0,1,2,3,4\n1,1,2,3,4\n");
  const auto load = [&](const std::string& name) -> std::string {
    try {
      LoadLogs({(folder_ / name).string()}, std::string(TENDRIL_SOURCE_DIR) + "/config/robots/rig_60mm.yaml");
    } catch (const std::exception& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_THAT(load("twice.csv"), HasSubstr("twice.csv:1: columns 2 and 5 are both called tension_N_1"));
  Write("times.csv", "# x\nt_s,tension_N_1,t_s\n0,1,2\n1,1,2\n");
  EXPECT_THAT(load("times.csv"), HasSubstr("times.csv:2: columns 1 and 3 are both called t_s"));
  Write("late.csv", "some,text\nmore,text\nt_s,tension_N_1\n0,1\n1,1\n");
  EXPECT_THAT(load("late.csv"), HasSubstr("set table: {skip_lines: 2} in a map"));
}

TEST_F(TableFormsTest, AMapThatSaysAnotherMarkOrDelimiterIsToldSo) {
  const std::string rest = "time: {column: t}\ncolumns: {tension: {names: [a, b, c]}}\n";
  const std::string table = "t,a,b,c\n0,1.5,2,3\n1,1.5,2,3\n";
  EXPECT_THAT(Refusal("table: {decimal: comma, delimiter: comma}\n" + rest, table),
              HasSubstr("'1.5' is not a number"));
  EXPECT_THAT(Refusal("table: {decimal: comma, delimiter: comma}\n" + rest, table),
              HasSubstr("decimals have a comma: set table: {decimal: point} in it"));
  EXPECT_THAT(Refusal("table: {delimiter: tab}\n" + rest, table),
              HasSubstr("the cells have another delimiter: set table: {delimiter: auto} in the map"));
}

// As in robot files: which of the two counts is unknown.
TEST_F(TableFormsTest, AKeyThatIsThereTwiceIsRefused) {
  const std::string table = "t,a,b,c\n0,1,2,3\n1,1,2,3\n";
  EXPECT_THAT(
      Refusal("time: {column: t}\ncolumns: {tension: {names: [a, b, c]}}\ntime: {column: c}\n", table),
      HasSubstr(":3: time: given twice (first on line 1); accepted: once; remove one of them"));
  EXPECT_THAT(
      Refusal("time: {column: t}\ncolumns:\n  tension:\n    names: [a, b, c]\n    names: [c, b, a]\n", table),
      HasSubstr(":5: names: given twice (first on line 4)"));
}

TEST_F(TableFormsTest, OtherEncodingsAndWorkbooksAreRefused) {
  std::string utf16;
  for (const char c : "t,a,b\n" + kRows) utf16 += std::string{c, '\0'};
  EXPECT_THAT(Refusal(kMap, utf16), HasSubstr("the text is UTF-16"));
  EXPECT_THAT(Refusal(kMap, "\xFF\xFE" + utf16), HasSubstr("the text is UTF-16"));
  EXPECT_THAT(Refusal(kMap, std::string(1, '\0') + utf16), HasSubstr("the text is UTF-16"));
  EXPECT_THAT(Refusal(kMap, "PK\x03\x04 and so on"), HasSubstr("export it as CSV"));
}

TEST_F(TableFormsTest, ThousandsSeparatorsAreRefused) {
  for (const char* cell : {"1,234.5", "1.234,5", "1 234", "1'234.5", "1,234,567",
                           "12\xC2\xA0"
                           "345,6"}) {
    EXPECT_THAT(Refusal(kMap, fmt::format("t,a,b\n0,1.5,2\n0.01,\"{}\",-3\n0.02,0.5,1\n", cell)),
                HasSubstr("thousands separators are not read"))
        << cell;
  }
  // Where either mark could be the decimal one, both in one table are a contradiction.
  EXPECT_THAT(Refusal(kMap, "t;a;b\n0;1,234;2\n0.01;1.25;-3\n0.02;0.5;1\n"),
              HasSubstr("table.csv:3: '0.01', but a decimal comma in line 2"));
  EXPECT_THAT(Refusal(kMap, "t;a;b\n0.01;1,234;2\n0.02;1.25;-3\n"),
              HasSubstr("table.csv:2: '1,234', but a decimal point in line 2"));
  EXPECT_THAT(Refusal("table: {decimal: comma}\n" + kMap, "t;a;b\n0;1.234;2\n0,01;1,25;-3\n"),
              HasSubstr("'1.234' is not a number"));
  ExpectRows("table: {decimal: comma}\n" + kMap, "t;a;b\n0;1,5;2\n0,01;1,25;-3\n0,02;0,5;1e-3\n");
}

TEST_F(TableFormsTest, NoValueIsWrittenInManyWays) {
  for (const char* none :
       {"",   "nan", "NaN",     "-nan",     "NA",        "N/A",     "#N/A",    "null", "None", "-",
        "--", "nil", "missing", "nan(ind)", "-nan(ind)", "1.#QNAN", "-1.#IND", "<NA>", "NaT",  "\"\""}) {
    const gap::Run run = Import(kMap, fmt::format("t,a,b\n0,1,2\n1,{},3\n2,3,4\n", none));
    EXPECT_TRUE(std::isnan(run.tension_N(1, 0))) << none;
    EXPECT_EQ(run.tension_N(1, 1), 3) << none;
  }
  EXPECT_THAT(Refusal(kMap, "t,a,b\n0,1,2\n1,off,3\n2,3,4\n"), HasSubstr("'off' is not a number"));
}

}  // namespace
}  // namespace tendril::gap
