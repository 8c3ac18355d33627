// `tendril model ik | inverse | inverse-tip` and `tendril capstan` as another program sees them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <sstream>
#include <string>
#include <vector>

namespace tendril::tools {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

class Program : public testing::Test {
 protected:
  Program() {
    std::string name = (std::filesystem::temp_directory_path() / "tendril-inverse-XXXXXX").string();
    directory_ = mkdtemp(name.data());
  }
  ~Program() override { std::filesystem::remove_all(directory_); }

  struct Result {
    int code;
    std::string out, error;
  };

  Result Run(const std::string& arguments, const std::string& input = "") const {
    std::ofstream(directory_ / "in") << input;
    const auto path = [&](const char* name) { return (directory_ / name).string(); };
    const std::string command = std::string(TENDRIL_PROGRAM) + " " + arguments + " < " + path("in") + " > " +
                                path("out") + " 2> " + path("error");
    const int status = std::system(command.c_str());
    const auto read = [&](const char* name) {
      std::ifstream file(path(name));
      return std::string(std::istreambuf_iterator<char>(file), {});
    };
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, read("out"), read("error")};
  }

  static std::string Robot(const std::string& name) {
    return " --robot " TENDRIL_SOURCE_DIR "/config/robots/" + name + ".yaml ";
  }

  static std::vector<std::vector<double>> Rows(const std::string& csv) {
    std::vector<std::vector<double>> rows;
    std::istringstream lines(csv);
    std::string line, cell;
    std::getline(lines, line);
    while (std::getline(lines, line)) {
      rows.emplace_back();
      for (std::istringstream cells(line); std::getline(cells, cell, ',');)
        rows.back().push_back(std::stod(cell));
    }
    return rows;
  }

  static double Field(const std::string& json, const std::string& name) {
    const auto at = json.find("\"" + name + "\"");
    return at == std::string::npos ? std::nan("") : std::stod(json.substr(json.find(':', at) + 1));
  }

  std::filesystem::path directory_;
};

TEST_F(Program, TensionsOfAnEquilibriumBringItBack) {
  for (const std::string robot : {"qi2021_90mm", "four_tendon_90mm", "two_section"}) {
    const int tendons = robot == "two_section" ? 6 : robot == "qi2021_90mm" ? 3 : 4;
    std::string header = "T1", row = "3.5";
    for (int j = 2; j <= tendons; ++j) {
      header += ",T" + std::to_string(j);
      row += j == 5 ? ",2" : ",0.3";
    }
    const auto statics = Run("model statics" + Robot(robot), header + "\n" + row + "\n");
    ASSERT_EQ(statics.code, 0) << statics.error;
    const auto shape = Rows(statics.out).at(0);
    const std::size_t units = (shape.size() - 3) / 2, sections = robot == "two_section" ? 2 : 1;

    std::ostringstream bend, tip;
    bend.precision(17);
    tip.precision(17);
    bend << (sections == 2 ? "us1,vs1,us2,vs2\n" : "us1,vs1\n");
    for (std::size_t s = 0; s < sections; ++s) {
      double u = 0, v = 0;
      for (std::size_t i = s * units / sections; i < (s + 1) * units / sections; ++i) {
        u += shape[2 * i];
        v += shape[2 * i + 1];
      }
      bend << (s ? "," : "") << u << "," << v;
    }
    tip << "x,y,z\n"
        << shape[2 * units] << "," << shape[2 * units + 1] << "," << shape[2 * units + 2] << "\n";

    const auto inverse =
        Run("model inverse --shape equilibrium --min-tension 0.3" + Robot(robot), bend.str());
    ASSERT_EQ(inverse.code, 0) << inverse.error;
    EXPECT_EQ(inverse.error, "");
    const auto tensions = Rows(inverse.out).at(0);
    ASSERT_EQ(static_cast<int>(tensions.size()), tendons);
    double effort = 0, given = 3.2 * 3.2 + (tendons > 4 ? 1.7 * 1.7 : 0);
    for (const double t : tensions) effort += (t - 0.3) * (t - 0.3);
    EXPECT_LE(effort, given * (1 + 1e-9)) << robot;
    if (tendons == 3) {
      EXPECT_NEAR(tensions[0], 3.5, 1e-9) << "no other three do it";
    }

    const auto at_tip = Run("model inverse-tip --min-tension 0.3" + Robot(robot), tip.str());
    ASSERT_EQ(at_tip.code, 0) << at_tip.error;
    EXPECT_EQ(at_tip.error, "");
    EXPECT_THAT(at_tip.out, StartsWith("T1,T2,T3"));
    ASSERT_EQ(Rows(at_tip.out).at(0).size(), tensions.size() + 2 * units);
  }
}

TEST_F(Program, ArcTensionsBalanceAndRatesComeTogether) {
  const auto still = Run("model inverse" + Robot("qi2021_90mm"), "vs1,us1\n0,1.6\n");
  ASSERT_EQ(still.code, 0) << still.error;
  const auto rest = Rows(still.out).at(0);
  EXPECT_NEAR(rest[1], 0.3, 1e-12);
  EXPECT_NEAR(rest[2], 0.3, 1e-12);
  EXPECT_GT(rest[0], 3.5);
  const auto moving = Run("model inverse" + Robot("qi2021_90mm"),
                          "us1,vs1,dus1,dvs1,ddus1,ddvs1\n1.6,0,0,0,0,0\n1.6,0,0,0,-50,0\n");
  const auto rows = Rows(moving.out);
  EXPECT_EQ(rows.at(0), rest);
  EXPECT_LT(rows.at(1)[0], rest[0]) << "swinging back needs less pull";
  const auto half = Run("model inverse" + Robot("qi2021_90mm"), "us1,vs1,dus1,dvs1\n1.6,0,0,0\n");
  EXPECT_EQ(half.code, 1);
  EXPECT_THAT(half.error, HasSubstr("together or not at all"));
}

TEST_F(Program, OutOfReachIsAnsweredAndSaid) {
  const auto ik = Run("model ik" + Robot("qi2021_90mm"), "x,y,z\n0.0286479,0,0.0496196\n0,0,0.09\n");
  EXPECT_EQ(ik.code, 0);
  EXPECT_THAT(ik.error, HasSubstr("line 2: out of reach: the nearest tip is"));
  EXPECT_THAT(ik.error, testing::Not(HasSubstr("line 3")));
  EXPECT_EQ(Rows(ik.out).size(), 2u);
  const auto inverse = Run("model inverse" + Robot("qi2021_90mm"), "us1,vs1\n4,0\n");
  EXPECT_EQ(inverse.code, 0);
  EXPECT_THAT(inverse.error, HasSubstr("line 2: out of reach between 0.3 and 8 N"));
  const auto millimetres = Run("model ik" + Robot("qi2021_90mm"), "x,y,z\n28.6,0,49.6\n0.2,0,0.5\n");
  EXPECT_THAT(millimetres.error, HasSubstr("m away; millimetres? That would be 0.0286 0 0.0496 m"));
  EXPECT_THAT(millimetres.error.substr(millimetres.error.find("line 3")),
              testing::Not(HasSubstr("millimetres")));
  const auto tip = Run("model inverse-tip" + Robot("qi2021_90mm"), "x,y,z\n0,0,0.2\n");
  EXPECT_EQ(tip.code, 0);
  EXPECT_THAT(tip.error, HasSubstr("m away"));
  // A long run of them does not flood the screen.
  std::string many = "x,y,z\n";
  for (int i = 0; i < 100; ++i) many += "0,0.1,0.2\n";
  const auto flood = Run("model ik" + Robot("qi2021_90mm"), many);
  EXPECT_LT(std::count(flood.error.begin(), flood.error.end(), '\n'), 15);
  EXPECT_THAT(flood.error, HasSubstr("100 rows"));
}

TEST_F(Program, WrongUseIsTwo) {
  EXPECT_EQ(Run("model inverse --shape triangle" + Robot("qi2021_90mm"), "us1,vs1\n").code, 2);
  const auto low = Run("model inverse --min-tension -1" + Robot("qi2021_90mm"), "us1,vs1\n");
  EXPECT_EQ(low.code, 2);
  EXPECT_THAT(low.error, HasSubstr("accepted 0 .. 8 N"));
  EXPECT_EQ(Run("model inverse-tip", "x,y,z\n").code, 2);
}

TEST_F(Program, CapstanPrintsBothSides) {
  const std::string rig = "capstan --alpha 0.466 --n 0.67 --rho 10 --wrap 3.141592653589793 ";
  const auto pull = Run(rig + "--tension 1");
  ASSERT_EQ(pull.code, 0) << pull.error;
  EXPECT_NEAR(Field(pull.out, "ratio"), 1.6654273428254590, 1e-9);
  EXPECT_NEAR(Field(pull.out, "tension_motor_N"), 1.6654273428254590, 1e-9);
  EXPECT_EQ(Field(pull.out, "tension_base_N"), 1);
  const auto release = Run(rig + "--tension 1.6654273428254590 --direction release");
  EXPECT_NEAR(Field(release.out, "tension_motor_N"), 1, 1e-9);
  const auto zero = Run(rig + "--tension 0");
  EXPECT_NEAR(Field(zero.out, "ratio"), std::cosh(std::sqrt(10) * std::numbers::pi), 1e-6);
  EXPECT_EQ(Field(zero.out, "tension_motor_N"), 0);
  const auto classic = Run("capstan --law classic --alpha 0.2 --wrap 2 --tension 3");
  EXPECT_NEAR(Field(classic.out, "ratio"), std::exp(0.4), 1e-14);
  const auto low = Run(rig + "--tension 0.001 --low-tension 0.05");
  EXPECT_NEAR(Field(low.out, "ratio"), 4.9979159760202, 1e-8);
}

TEST_F(Program, CapstanRefusesWhatMakesNoSense) {
  const std::string rest = " --wrap 3 --tension 1";
  for (const std::string bad :
       {"--alpha -1 --n 0.67 --rho 10", "--alpha 0.4 --n 0 --rho 10", "--alpha 0.4 --n 1.2 --rho 10",
        "--alpha 0.4 --n 0.67 --rho 0", "--alpha nan --n 0.67 --rho 10", "--alpha 0.4",
        "--alpha 0.4 --n 1 --rho 1 --law magic", "--alpha 0.4 --n 1 --rho 1 --direction up"}) {
    const auto result = Run("capstan " + bad + rest);
    EXPECT_EQ(result.code, 2) << bad;
    EXPECT_EQ(result.out, "") << bad;
    EXPECT_NE(result.error, "") << bad;
  }
  EXPECT_THAT(Run("capstan --alpha 0.4 --n 1.2 --rho 10" + rest).error,
              HasSubstr("--n: 1.2 is not a number from 0.05 to 1"));
}

}  // namespace
}  // namespace tendril::tools
