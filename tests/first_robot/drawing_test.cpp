// The picture: what it has, and that all of it is on the canvas. init_test.py checks that it is well-formed.
#include "tendril/first_robot/drawing.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <regex>
#include <string>

#include "tendril/config/config.h"

namespace tendril::first_robot {
namespace {

int Count(const std::string& text, const std::string& what) {
  int count = 0;
  for (std::size_t at = text.find(what); at != text.npos; at = text.find(what, at + 1)) ++count;
  return count;
}

/// Every pair "x,y" of a path or polyline, and every x1 ... y2.
void ExpectOnCanvas(const std::string& svg, const std::string& name) {
  static const std::regex kPair(R"((-?[0-9.]+),(-?[0-9.]+))"), kEnd(R"re(([xy])[12]?="(-?[0-9.]+)")re");
  const std::string body = svg.substr(svg.find("</defs>"));
  int pairs = 0;
  for (std::sregex_iterator it(body.begin(), body.end(), kPair), end; it != end; ++it, ++pairs) {
    const std::string whole = it->str();
    if (whole.find("0,3") == 0 || whole.find("0,-3") == 0) continue;  // the scale bar's relative strokes
    EXPECT_GE(std::stod((*it)[1]), 0) << name;
    EXPECT_LE(std::stod((*it)[1]), 900) << name;
    EXPECT_GE(std::stod((*it)[2]), 0) << name;
    EXPECT_LE(std::stod((*it)[2]), 640) << name;
  }
  EXPECT_GT(pairs, 20) << name;
  for (std::sregex_iterator it(body.begin(), body.end(), kEnd), end; it != end; ++it) {
    EXPECT_GE(std::stod((*it)[2]), 0) << name << ": " << it->str();
    EXPECT_LE(std::stod((*it)[2]), (*it)[1] == "x" ? 900 : 640) << name << ": " << it->str();
  }
}

TEST(Drawing, EveryShippedRobotIsWholeAndOnTheCanvas) {
  for (const char* name :
       {"rig_60mm", "rig_90mm", "qi2021_60mm", "four_tendon_90mm", "two_section", "pairs_90mm"}) {
    const RobotParameters robot =
        config::LoadRobot(std::string(TENDRIL_SOURCE_DIR "/config/robots/") + name + ".yaml");
    const std::string svg = Drawing(robot);
    ExpectOnCanvas(svg, name);
    EXPECT_EQ(Count(svg, "class=\"tendon\""), 2 * robot.body.tendons()) << name;
    EXPECT_EQ(Count(svg, "class=\"disk\""), 2 * robot.body.units()) << name;
    EXPECT_EQ(Count(svg, "class=\"backbone\""), 2) << name;
    for (const char* part :
         {"class=\"base\"", "class=\"gravity\"", "class=\"scale\"", " mm</text>", "gravity 9.81 m/s²"})
      EXPECT_EQ(Count(svg, part) > 0, true) << name << " lacks " << part;
  }
}

TEST(Drawing, LongAndThinOrBentToACircleStaysOnTheCanvas) {
  RobotParameters robot = config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/two_section.yaml");
  robot.limits.max_bending_rad = 6.2;
  ExpectOnCanvas(Drawing(robot), "circles");
  for (SectionParameters& s : robot.body.sections) s.unit_length_m = 1;
  robot.limits.max_bending_rad = 0.01;
  ExpectOnCanvas(Drawing(robot), "long");
  for (SectionParameters& s : robot.body.sections) {
    s.unit_length_m = 1e-3;
    for (TendonRoute& t : s.tendons) t.radius_m = 0.3;
  }
  ExpectOnCanvas(Drawing(robot), "wide");
}

TEST(Drawing, ShowsWhereGravityPoints) {
  RobotParameters robot = config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml");
  robot.body.gravity_W_mps2 = {0, 9.81, 0};
  EXPECT_EQ(Count(Drawing(robot), "gravity into the page"), 1);
  robot.body.gravity_W_mps2 = {0, 0, 0};
  EXPECT_EQ(Count(Drawing(robot), "no gravity"), 1);
}

}  // namespace
}  // namespace tendril::first_robot
