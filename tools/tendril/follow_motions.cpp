// A paragraph for each motion.
#include "follow_motions.h"

#include "number_option.h"

namespace tendril::tools {
namespace {

void AddTips(CLI::App& sub, motion::MotionRequest& request, const char* what) {
  sub.add_option("--tip", request.tips, what)->allow_extra_args(false)->option_text("X,Y,Z [m] ...");
}

void AddPathLimits(CLI::App& sub, motion::MotionRequest& request) {
  sub.add_option("--speed", request.speed_radps,
                 "of a section's bend at most [rad/s]; 0: the daemon's default_speed_radps")
      ->check(NumberFrom(0, 1e3, "leave it out for the daemon's own"));
  sub.add_option("--acceleration", request.acceleration_radps2, "[rad/s^2]; 0: that speed in 0.25 s")
      ->check(NumberFrom(0, 1e6, "leave it out for that speed in 0.25 s"));
  sub.add_option("--jerk", request.jerk_radps3, "[rad/s^3]; 0: that acceleration in 0.1 s")
      ->check(NumberFrom(0, 1e9, "leave it out for that acceleration in 0.1 s"));
}

}  // namespace

CLI::App* AddMotion(CLI::App& follow, motion::MotionRequest& request, const char* name,
                    const char* description, const std::function<void()>& run) {
  CLI::App* sub = follow.add_subcommand(name, description)->fallthrough();
  sub->footer("The options of `tendril follow` can be given here too.");
  sub->callback([&request, name, run] {
    request.kind = name;
    run();
  });
  return sub;
}

void AddNearest(CLI::App& sub, motion::MotionRequest& request) {
  sub.add_flag("--nearest", request.nearest,
               "replace points out of reach by the nearest that the tip can reach");
}

void AddPlannedMotions(CLI::App& follow, motion::MotionRequest& request, const std::function<void()>& run) {
  const auto add = [&](const char* name, const char* description) {
    return AddMotion(follow, request, name, description, run);
  };
  add("circle", "The paper's tip circle, as in `tendril demo`");
  add("planar", "The paper's bend in a plane");
  add("fast_circle", "The circle at one revolution per second");
  add("square", "A square of the tip, at rest in its corners");
  add("spiral", "A spiral of the tip, outwards and back");

  CLI::App* via = add("via", "Through points without stopping, as fast as limits allow");
  AddTips(*via, request, "a point for the tip; repeat");
  via->add_option("--bend", request.bends, "a point as bends of all sections; repeat")
      ->allow_extra_args(false)
      ->option_text("U,V,... [rad] ...");
  via->add_option("--points", request.points,
                  "points as CSV: columns tip_x_m,tip_y_m,tip_z_m or us_1,vs_1,us_2,...");
  AddNearest(*via, request);
  AddPathLimits(*via, request);

  CLI::App* line = add("line", "Straight lines of the tip, at rest in each corner");
  AddTips(*line, request, "a corner; repeat");
  AddNearest(*line, request);
  AddPathLimits(*line, request);

  CLI::App* arc = add("arc", "An arc of the tip: by three points, or around a centre");
  AddTips(*arc, request,
          "three points in the order in which they are passed; with --centre: where it starts");
  arc->add_option("--centre", request.centre, "of the arc")->option_text("X,Y,Z [m]");
  arc->add_option("--normal", request.normal, "of its plane; right-handed")
      ->option_text("X,Y,Z")
      ->capture_default_str();
  arc->add_option("--angle", request.angle_deg, "by which it turns [deg]; may be negative or more than 360")
      ->check(NumberFrom(-7200, 7200, "give degrees"));
  AddNearest(*arc, request);
  AddPathLimits(*arc, request);

  CLI::App* csv = add("csv", "Through the rows of a table at their times");
  csv->add_option(
         "file", request.points,
         "CSV: columns t_s and tip_x_m,tip_y_m,tip_z_m or us_1,vs_1,us_2,...; the first row is the start")
      ->required();
  csv->add_option("--stretch", request.stretch, "times are multiplied by this")
      ->check(NumberFrom(0.01, 1000, "give 1 for the table's own times"))
      ->capture_default_str();
  AddNearest(*csv, request);
}

}  // namespace tendril::tools
