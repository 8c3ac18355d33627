// `tendril model` as another program sees it: columns by name, 17 digits, one clear line for what is wrong.
#include <fmt/ranges.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <sstream>
#include <string>

#include "golden.h"
#include "tendril/io/csv.h"

namespace tendril::tools {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::StartsWith;

std::string Refusal(const std::string& text, std::vector<std::string> required,
                    std::vector<std::vector<std::string>> optional = {}) {
  std::istringstream in(text);
  try {
    io::CsvReader rows(in, "in", std::move(required), std::move(optional));
    while (rows.Next()) {
    }
  } catch (const std::runtime_error& e) {
    return e.what();
  }
  return "accepted";
}

TEST(Csv, ColumnsAreMatchedByNameInAnyOrder) {
  std::istringstream in("\xEF\xBB\xBF b , \"a\",fy,fx\r\n 2 ,1,4,3\r\n\r\n+5,-6e-3,7,8");
  io::CsvReader rows(in, "in", {"a", "b"}, {{"fx", "fy"}, {"t"}});
  ASSERT_TRUE(rows.Next());
  EXPECT_THAT(rows.required(), ElementsAre(1, 2));
  EXPECT_TRUE(rows.has(0));
  EXPECT_THAT(rows.optional(0), ElementsAre(3, 4));
  EXPECT_FALSE(rows.has(1));
  ASSERT_TRUE(rows.Next());
  EXPECT_THAT(rows.required(), ElementsAre(-6e-3, 5));
  EXPECT_EQ(rows.line(), 4u);
  EXPECT_FALSE(rows.Next());
}

TEST(Csv, WhatIsWrongIsSaidWithItsLine) {
  EXPECT_THAT(Refusal("", {"a"}), HasSubstr("empty input"));
  EXPECT_THAT(Refusal("\n\n", {"a"}), HasSubstr("empty input"));
  EXPECT_THAT(Refusal("a\n1", {"a", "b"}), HasSubstr("line 1: missing column b"));
  EXPECT_THAT(Refusal("a,c\n1,2", {"a"}), HasSubstr("line 1: unknown column 'c'"));
  EXPECT_THAT(Refusal("a,a\n1,2", {"a"}), HasSubstr("appears twice"));
  EXPECT_THAT(Refusal("a,x\n1,2", {"a"}, {{"x", "y"}}), HasSubstr("missing column y"));
  EXPECT_THAT(Refusal("a\n1\nabc", {"a"}), HasSubstr("line 3: column 1: 'abc' is not a number"));
  EXPECT_THAT(Refusal("a\n1x", {"a"}), HasSubstr("not a number"));
  EXPECT_THAT(Refusal("a,b\n1,", {"a", "b"}), HasSubstr("'' is not a number"));
  EXPECT_THAT(Refusal("a\nnan", {"a"}), HasSubstr("not finite"));
  EXPECT_THAT(Refusal("a\n-inf", {"a"}), HasSubstr("not finite"));
  EXPECT_THAT(Refusal("a\n1e999", {"a"}), HasSubstr("not finite"));
  EXPECT_THAT(Refusal("a,b\n1", {"a", "b"}), HasSubstr("1 value for 2 columns"));
  EXPECT_THAT(Refusal("a\n1,2", {"a"}), HasSubstr("2 values for 1 column"));
  EXPECT_EQ(Refusal("a\n1e-400\n", {"a"}), "accepted");  // zero for every purpose
}

class ModelCommand : public testing::Test {
 protected:
  ModelCommand() {
    std::string name = (std::filesystem::temp_directory_path() / "tendril-model-XXXXXX").string();
    directory_ = mkdtemp(name.data());
  }
  ~ModelCommand() override { std::filesystem::remove_all(directory_); }

  struct Result {
    int code;
    std::string out, error;
  };

  std::filesystem::path Write(const std::string& name, const std::string& text) const {
    std::ofstream(directory_ / name) << text;
    return directory_ / name;
  }

  Result Run(const std::string& arguments, const std::string& input,
             const std::string& robot = "qi2021_90mm") const {
    const auto in = Write("in", input);
    const std::string command = std::string(TENDRIL_PROGRAM) + " model " + arguments + " --robot " +
                                TENDRIL_SOURCE_DIR "/config/robots/" + robot + ".yaml < " + in.string() +
                                " > " + (directory_ / "out").string() + " 2> " +
                                (directory_ / "error").string();
    const int status = std::system(command.c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, Read("out"), Read("error")};
  }

  static Eigen::MatrixXd Rows(const std::string& csv) {
    std::istringstream in(csv);
    std::string line, cell;
    std::getline(in, line);
    std::vector<std::vector<double>> rows;
    while (std::getline(in, line)) {
      rows.emplace_back();
      for (std::istringstream cells(line); std::getline(cells, cell, ',');)
        rows.back().push_back(std::stod(cell));
    }
    Eigen::MatrixXd values(static_cast<Eigen::Index>(rows.size()),
                           rows.empty() ? 0 : static_cast<Eigen::Index>(rows[0].size()));
    for (Eigen::Index i = 0; i < values.rows(); ++i) {
      values.row(i) =
          Eigen::Map<const Eigen::RowVectorXd>(rows[static_cast<std::size_t>(i)].data(), values.cols());
    }
    return values;
  }

 private:
  std::string Read(const std::string& name) const {
    std::ostringstream text;
    text << std::ifstream(directory_ / name).rdbuf();
    return text.str();
  }

  std::filesystem::path directory_;
};

TEST_F(ModelCommand, AccelGivesTheIndependentAccelerationsToTheLastDigits) {
  const test::Golden golden("accel_paper.csv");
  std::string input =
      fmt::format("{}\n", fmt::join(io::Columns(io::Numbered("T", 3), io::NumberedPairs("dv", "du", 4),
                                                io::NumberedPairs("u", "v", 4)),
                                    ","));
  for (std::size_t row = 0; row < golden.size(); ++row) {
    Eigen::VectorXd dq = golden.At(row, "du1", 8);
    for (int i = 0; i < 8; i += 2) std::swap(dq[i], dq[i + 1]);
    input += fmt::format("{},{},{}\n", fmt::join(golden.At(row, "T1", 3), ","), fmt::join(dq, ","),
                         fmt::join(golden.At(row, "u1", 8), ","));
  }
  const Result result = Run("accel", input);
  ASSERT_EQ(result.code, 0) << result.error;
  EXPECT_THAT(result.out, StartsWith("ddu1,ddv1,ddu2,ddv2,ddu3,ddv3,ddu4,ddv4\n"));
  const Eigen::MatrixXd rows = Rows(result.out);
  ASSERT_EQ(rows.rows(), static_cast<Eigen::Index>(golden.size()));
  for (Eigen::Index i = 0; i < rows.rows(); ++i) {
    const Eigen::VectorXd expected = golden.At(static_cast<std::size_t>(i), "ddu1", 8);
    EXPECT_LT((rows.row(i).transpose() - expected).norm(), 1e-12 * expected.norm()) << i;
  }
}

TEST_F(ModelCommand, MassEnergyFkStaticsAndFrequenciesHaveTheAgreedColumns) {
  const std::string q = "u1,v1,u2,v2,u3,v3,u4,v4", dq = "du1,dv1,du2,dv2,du3,dv3,du4,dv4";
  EXPECT_THAT(Run("mass", q).out, StartsWith("H11,H12,H13,H14,H15,H16,H17,H18,H21,"));
  EXPECT_EQ(Rows(Run("mass", q + "\n0,0,0,0,0,0,0,0").out).cols(), 64);
  EXPECT_EQ(Run("energy", q + "," + dq).out, "kinetic,elastic,gravity\n");
  EXPECT_EQ(Run("fk", q).out, "x,y,z,qw,qx,qy,qz,L1,L2,L3\n");
  EXPECT_EQ(Run("statics", "T1,T2,T3").out, q + ",x,y,z\n");
  EXPECT_EQ(Run("frequencies", "T1,T2,T3").out, "f1,f2,f3,f4,f5,f6,f7,f8\n");
  // A quarter circle in the x-z plane.
  const double bend = std::numbers::pi / 8, radius = 0.09 / (std::numbers::pi / 2);
  const Eigen::MatrixXd tip = Rows(Run("fk", q + fmt::format("\n{0},0,{0},0,{0},0,{0},0", bend)).out);
  EXPECT_NEAR(tip(0, 0), radius, 1e-15);
  EXPECT_NEAR(tip(0, 2), radius, 1e-15);
  EXPECT_NEAR(tip(0, 3), std::sqrt(0.5), 1e-15);
  EXPECT_NEAR(tip(0, 5), std::sqrt(0.5), 1e-15);
}

TEST_F(ModelCommand, UnitsThatTwistAndStretchHaveTheirColumns) {
  const std::string robot = "rod_5disks";
  const Result fk = Run("fk", "", robot);
  EXPECT_THAT(fk.error, HasSubstr("u1,v1,w1,e1,sx1,sy1,u2,v2,"));
  EXPECT_THAT(Run("accel", "", robot).error, HasSubstr("du10,dv10,dw10,de10,dsx10,dsy10,T1,T2,T3"));
  EXPECT_THAT(Run("statics", "T1,T2,T3", robot).out, StartsWith("u1,v1,w1,e1,sx1,sy1,u2,v2,"));
  const Result twisted = Run("statics --disks", "mz,my,mx,T1,T2,T3\n0.01,0,0,1,1,1\n", robot);
  ASSERT_EQ(twisted.code, 0) << twisted.error;
  EXPECT_THAT(twisted.out, HasSubstr(",x,y,z,x1,y1,z1,qw1,qx1,qy1,qz1,x2,"));
  const Eigen::MatrixXd row = Rows(twisted.out);
  ASSERT_EQ(row.cols(), 60 + 3 + 5 * 7);
  // The last disk is where the tip is, turned about z by the sum of all torsions.
  EXPECT_LT((row.block(0, 60, 1, 3) - row.block(0, 63 + 4 * 7, 1, 3)).norm(), 1e-16);
  double turn_rad = 0;
  for (int i = 0; i < 10; ++i) turn_rad += row(0, 6 * i + 2);
  EXPECT_NEAR(row(0, 63 + 4 * 7 + 6), std::sin(0.5 * turn_rad), 1e-12);
  EXPECT_GT(turn_rad, 0.1);
}

TEST_F(ModelCommand, WhatKnowsBendingAloneRefusesOtherStrains) {
  for (const char* command : {"ik", "inverse", "inverse-tip"}) {
    const Result result = Run(command, "", "rod_5disks");
    EXPECT_EQ(result.code, 1) << command;
    EXPECT_EQ(std::count(result.error.begin(), result.error.end(), '\n'), 1);
    EXPECT_THAT(result.error,
                HasSubstr("body.sections[1].strains: torsion, extension, shear: tendril model " +
                          std::string(command) + " knows bending alone"));
  }
}

TEST_F(ModelCommand, ABadRowStopsWithItsLineAfterTheGoodOnes) {
  const Result result = Run("statics", "T1,T2,T3\n1,1,1\n1,x,1\n2,2,2\n");
  EXPECT_EQ(result.code, 1);
  EXPECT_EQ(Rows(result.out).rows(), 1);
  EXPECT_THAT(result.error, HasSubstr("line 3"));
  EXPECT_EQ(std::count(result.error.begin(), result.error.end(), '\n'), 1);
}

TEST_F(ModelCommand, WhatHasNoAnswerIsSaidInOneLine) {
  Result result = Run("statics", "T1,T2,T3\n8,8,8\n");
  EXPECT_EQ(result.code, 1);
  EXPECT_THAT(result.error, HasSubstr("line 2: no stable equilibrium"));
  EXPECT_THAT(result.error, HasSubstr("97.6091 %"));
  result = Run("frequencies", "T1,T2,T3\n8,8,8\n");
  EXPECT_EQ(result.code, 1);
  EXPECT_THAT(result.error, HasSubstr("no stable equilibrium"));
  result = Run("statics", "T1,T2,T3\n1,1,-1\n");
  EXPECT_EQ(result.code, 1);
  EXPECT_THAT(result.error, HasSubstr("tendons only pull"));
  result = Run("fk", "u1,v1,u2,v2,u3,v3,u4,v4\n0,0,0,0,7,0,0,0\n");
  EXPECT_EQ(result.code, 1);
  EXPECT_THAT(result.error, HasSubstr("unit 3"));
  EXPECT_EQ(Run("statics --nonsense 1", "T1,T2,T3\n").code, 2);
  EXPECT_EQ(Run("simulate --rtol 0", "t,T1,T2,T3\n").code, 2);
}

TEST_F(ModelCommand, SimulateContinuesFromItsOwnOutput) {
  const std::string robot = "rig_90mm";
  const Result whole = Run("simulate --step 0.01", "t,T1,T2,T3\n0,1,1,1\n0.02,3,1,1\n0.04,3,1,1\n", robot);
  ASSERT_EQ(whole.code, 0) << whole.error;
  const Eigen::MatrixXd rows = Rows(whole.out);
  ASSERT_EQ(rows.rows(), 5);
  EXPECT_EQ(rows.cols(), 17);

  std::istringstream lines(whole.out);
  std::string header, line;
  std::getline(lines, header);
  for (int i = 0; i < 3; ++i) std::getline(lines, line);  // t = 0.02
  const auto initial = Write("initial.csv", header + "\n" + line + "\n");
  const Result second = Run("simulate --step 0.01 --initial " + initial.string(),
                            "t,T1,T2,T3\n0.02,3,1,1\n0.04,3,1,1\n", robot);
  ASSERT_EQ(second.code, 0) << second.error;
  const Eigen::MatrixXd rest = Rows(second.out);
  EXPECT_LT((rest.bottomRows(1) - rows.bottomRows(1)).norm(), 1e-8 * rows.bottomRows(1).norm());

  const Result back = Run("simulate", "t,T1,T2,T3\n0,1,1,1\n0,3,1,1\n", robot);
  EXPECT_EQ(back.code, 1);
  EXPECT_THAT(back.error, HasSubstr("line 3: t = 0 does not come after 0"));
}

}  // namespace
}  // namespace tendril::tools
