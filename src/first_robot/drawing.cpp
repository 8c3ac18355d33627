// Points come from the model in metres; one mapping puts all of them on the canvas.
#include "tendril/first_robot/drawing.h"

#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "tendril/model/body.h"
#include "tendril/model/pull_cone.h"
#include "tendril/model/shape_points.h"

namespace tendril::first_robot {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using model::Body;
using model::Pose;

constexpr double kWidth = 900, kHeight = 640, kMargin = 40, kLegend = 250;  // px
// Distinct for the colour-blind as well.
constexpr std::string_view kColours[] = {"#0072b2", "#d55e00", "#009e73", "#cc79a7"};
constexpr std::string_view kBackbone = "#222", kFaint = "#9aa0a6";

Vector2d Side(const Vector3d& p_W) { return {p_W.x(), p_W.z()}; }

/// Diameter of the disk of a unit (from 0): that of a uniform thin disk with its inertia, around all holes.
double Diameter(const BodyParameters& body, const SectionParameters& section) {
  double diameter_m = std::sqrt(16 * section.disk_inertia_xx_kgm2 / section.unit_mass_kg);
  for (const SectionParameters& s : body.sections) {
    for (const TendonRoute& t : s.tendons) diameter_m = std::max(diameter_m, 2.2 * t.radius_m);
  }
  return diameter_m;
}

/// All sections bent to the limit: towards +x, or as near to it as the base section's tendons pull.
Eigen::VectorXd FullBend(const RobotParameters& robot, const Body& body) {
  Eigen::VectorXd us_vs(2 * body.sections());
  for (int k = 0; k < body.sections(); ++k) {
    const model::PullCone cone = model::PullConeOf(robot.body, k);
    Vector2d bend = cone.Nearest({1, 0});
    if (bend.norm() < 0.1) bend = Vector2d(std::cos(cone.from_rad), std::sin(cone.from_rad));
    us_vs.segment<2>(2 * k) = robot.limits.max_bending_rad * bend.normalized();
  }
  Eigen::VectorXd q(body.dof());
  body.SpreadBending(us_vs, q);
  return q;
}

/// One shape in the side view [m].
struct Shape {
  std::vector<Vector2d> backbone, tangents;          // at the frames
  std::vector<std::pair<Vector2d, Vector2d>> disks;  // ends of their edges
  std::vector<std::vector<Vector2d>> tendons;        // through the holes
};

Shape ShapeOf(const RobotParameters& robot, const Body& body, const Eigen::VectorXd& q) {
  const std::vector<Pose> frames = model::DiskPoses(body, q);
  Shape shape;
  for (const Pose& f : frames) {
    shape.backbone.push_back(Side(f.p_WA));
    shape.tangents.push_back(Side(f.R_WA.col(2)));
  }
  for (int k = 0; k < body.sections(); ++k) {
    const double half_m = Diameter(robot.body, robot.body.sections[static_cast<std::size_t>(k)]) / 2;
    for (int unit = body.first_unit(k); unit < body.end_unit(k); ++unit) {
      const Pose& f = frames[static_cast<std::size_t>(unit) + 1];
      const Vector2d axis = Side(f.R_WA.col(2));
      const Vector2d along = Vector2d(axis.y(), -axis.x()).normalized() * half_m;
      shape.disks.emplace_back(Side(f.p_WA) - along, Side(f.p_WA) + along);
    }
  }
  for (int tendon = 0; tendon < body.tendons(); ++tendon) {
    const Eigen::Matrix3Xd at = model::TendonHoles(body, q, tendon);
    std::vector<Vector2d> holes;
    for (Eigen::Index i = 0; i < at.cols(); ++i) holes.push_back(Side(at.col(i)));
    shape.tendons.push_back(std::move(holes));
  }
  return shape;
}

/// Metres to pixels: everything fits beside the legend.
class Canvas {
 public:
  explicit Canvas(const std::vector<Vector2d>& points) {
    Vector2d low = points.front(), high = points.front();
    for (const Vector2d& p : points) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
    const Vector2d size = (high - low).cwiseMax(1e-6);
    const Vector2d room(kWidth - kLegend - 2 * kMargin, kHeight - 2 * kMargin);
    scale_ = std::min(room.x() / size.x(), room.y() / size.y());
    origin_ = Vector2d(kMargin + (room.x() - scale_ * size.x()) / 2 - scale_ * low.x(),
                       kHeight - kMargin - (room.y() - scale_ * size.y()) / 2 + scale_ * low.y());
  }
  double scale() const { return scale_; }
  Vector2d At(const Vector2d& p) const {
    return {origin_.x() + scale_ * p.x(), origin_.y() - scale_ * p.y()};
  }
  std::string Text(const Vector2d& p) const { return fmt::format("{:.2f},{:.2f}", At(p).x(), At(p).y()); }

 private:
  double scale_;
  Vector2d origin_;
};

/// Circular arcs between the frames, as Bézier curves with the arcs' ends and tangents.
std::string BackbonePath(const Shape& shape, const Canvas& canvas, const Body& body,
                         const Eigen::VectorXd& q) {
  std::string path = fmt::format("M{}", canvas.Text(shape.backbone[0]));
  for (std::size_t i = 1; i < shape.backbone.size(); ++i) {
    const double angle_rad = q.segment<2>(2 * static_cast<Eigen::Index>(i - 1)).norm();
    double length_m = 0;
    for (int k = 0; k < body.sections(); ++k) {
      if (static_cast<int>(i) > body.first_unit(k))
        length_m = body.parameters().sections[static_cast<std::size_t>(k)].unit_length_m;
    }
    const double arm_m =
        length_m * (angle_rad > 1e-6 ? 4. / 3 * std::tan(angle_rad / 4) / angle_rad : 1. / 3);
    path += fmt::format(" C{} {} {}", canvas.Text(shape.backbone[i - 1] + arm_m * shape.tangents[i - 1]),
                        canvas.Text(shape.backbone[i] - arm_m * shape.tangents[i]),
                        canvas.Text(shape.backbone[i]));
  }
  return path;
}

std::string ShapeGroup(const Shape& shape, const Canvas& canvas, const Body& body, const Eigen::VectorXd& q,
                       bool faint) {
  std::string svg =
      fmt::format("<g class=\"{}\"{}>\n", faint ? "straight" : "bent", faint ? " opacity=\"0.4\"" : "");
  for (std::size_t j = 0; j < shape.tendons.size(); ++j) {
    std::string points;
    for (const Vector2d& p : shape.tendons[j]) points += fmt::format("{} ", canvas.Text(p));
    svg += fmt::format(
        "<polyline class=\"tendon\" points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"1.3\"/>\n",
        points, kColours[static_cast<std::size_t>(body.tendon_section(static_cast<int>(j)))]);
  }
  for (const auto& [from, to] : shape.disks) {
    svg += fmt::format(
        "<line class=\"disk\" x1=\"{:.2f}\" y1=\"{:.2f}\" x2=\"{:.2f}\" y2=\"{:.2f}\" stroke=\"{}\" "
        "stroke-width=\"3\" stroke-linecap=\"round\"/>\n",
        canvas.At(from).x(), canvas.At(from).y(), canvas.At(to).x(), canvas.At(to).y(), kFaint);
  }
  return svg +
         fmt::format(
             "<path class=\"backbone\" d=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"3\"/>\n</g>\n",
             BackbonePath(shape, canvas, body, q), kBackbone);
}

std::string Label(double x, double y, const std::string& text, std::string_view more = "") {
  return fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\"{}>{}</text>\n", x, y, more, text);
}

/// The plate that the robot stands on, hatched below.
std::string Base(const Canvas& canvas, double half_m) {
  const double half = std::clamp(canvas.scale() * half_m * 1.6, 12., 120.);
  const Vector2d at = canvas.At({0, 0});
  std::string svg = fmt::format(
      "<g class=\"base\"><line x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\" stroke=\"#222\" "
      "stroke-width=\"3\"/>\n",
      at.x() - half, at.y(), at.x() + half, at.y());
  for (double x = -half + 8; x <= half; x += 8) {
    svg += fmt::format("<line x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\" stroke=\"#222\"/>\n",
                       at.x() + x, at.y(), at.x() + x - 8, at.y() + 8);
  }
  return svg + "</g>\n";
}

/// An arrow in the view's plane, or the tip or tail of one across it.
std::string Gravity(const Vector3d& gravity_W_mps2, double x, double y) {
  const double size_mps2 = gravity_W_mps2.norm();
  if (size_mps2 == 0) return Label(x, y + 5, "no gravity");
  const Vector2d side = Side(gravity_W_mps2) / size_mps2;
  std::string svg = "<g class=\"gravity\">";
  if (side.norm() < 0.1) {
    svg += fmt::format(
        "<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"9\" fill=\"none\" stroke=\"#222\" stroke-width=\"2\"/>",
        x + 30, y);
    svg += Label(x + 72, y + 5, gravity_W_mps2.y() > 0 ? "gravity into the page" : "gravity out of the page");
    return svg + "</g>\n";
  }
  const Vector2d to(x + 30 + 26 * side.x(), y - 26 * side.y()),
      from(x + 30 - 26 * side.x(), y + 26 * side.y());
  svg += fmt::format(
      "<line x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\" stroke=\"#222\" stroke-width=\"2\" "
      "marker-end=\"url(#tip)\"/>",
      from.x(), from.y(), to.x(), to.y());
  return svg + Label(x + 72, y + 5, fmt::format("gravity {:.3g} m/s²", size_mps2)) + "</g>\n";
}

/// 1, 2 or 5 times a power of ten, of 60 to 150 px.
std::string ScaleBar(const Canvas& canvas, double x, double y) {
  const double power_m = std::pow(10, std::floor(std::log10(150 / canvas.scale())));
  double length_m = power_m;
  for (const double factor : {2., 5.}) {
    if (factor * power_m * canvas.scale() <= 150) length_m = factor * power_m;
  }
  const double end = x + length_m * canvas.scale();
  return fmt::format(
             "<g class=\"scale\"><path d=\"M{0:.2f},{2:.1f} v-6 m0,3 H{1:.2f} m0,-3 v6\" fill=\"none\" "
             "stroke=\"#222\" "
             "stroke-width=\"2\"/>\n",
             x, end, y) +
         Label(x, y + 20, fmt::format("{:g} mm", 1e3 * length_m)) + "</g>\n";
}

std::string Legend(const RobotParameters& robot, const Canvas& canvas) {
  const double x = kWidth - kLegend + 10;
  std::string svg = Label(x, 50, robot.name.size() > 24 ? robot.name.substr(0, 22) + "…" : robot.name,
                          " font-weight=\"bold\" font-size=\"16\"");
  svg += Label(x, 76, fmt::format("length {:.4g} mm", 1e3 * robot.body.length_m()));
  svg += Label(x, 98, fmt::format("pale: straight; full: bent {:.3g} rad", robot.limits.max_bending_rad));
  svg += Label(x, 116, robot.body.sections.size() > 1 ? "in every section" : "(limits.max_bending_rad)");
  double y = 150;
  for (std::size_t k = 0; k < robot.body.sections.size(); ++k, y += 24) {
    const SectionParameters& s = robot.body.sections[k];
    svg += fmt::format(
        "<line x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\" stroke=\"{}\" stroke-width=\"3\"/>\n",
        x, y - 5, x + 22, y - 5, kColours[k]);
    svg += Label(x + 30, y,
                 fmt::format("section {}: {} disks, {} tendon{}", k + 1, s.units, s.tendons.size(),
                             s.tendons.size() == 1 ? "" : "s"));
  }
  svg += Gravity(robot.body.gravity_W_mps2, x, y + 50);
  svg += Label(x, kHeight - 100, "side view: x to the right, z up");
  return svg + ScaleBar(canvas, x, kHeight - 60);
}

}  // namespace

std::string Drawing(const RobotParameters& robot) {
  const Body body(robot.body);
  const Eigen::VectorXd straight = Eigen::VectorXd::Zero(body.dof()), bent = FullBend(robot, body);
  const Shape shapes[] = {ShapeOf(robot, body, straight), ShapeOf(robot, body, bent)};
  std::vector<Vector2d> points;
  for (const Shape& shape : shapes) {
    points.insert(points.end(), shape.backbone.begin(), shape.backbone.end());
    for (const auto& [from, to] : shape.disks) points.insert(points.end(), {from, to});
    for (const auto& holes : shape.tendons) points.insert(points.end(), holes.begin(), holes.end());
  }
  const double half_m = Diameter(robot.body, robot.body.sections.front()) / 2;
  points.insert(points.end(), {{-2 * half_m, 0}, {2 * half_m, -0.02 * robot.body.length_m()}});
  const Canvas canvas(points);
  std::string svg = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0} {1}\" width=\"{0}\" height=\"{1}\" "
      "font-family=\"sans-serif\" font-size=\"13\" fill=\"#222\">\n"
      "<title>{2}: straight, and bent to its limit</title>\n"
      "<defs><marker id=\"tip\" viewBox=\"0 0 10 10\" refX=\"9\" refY=\"5\" markerWidth=\"6\" "
      "markerHeight=\"6\" "
      "orient=\"auto\"><path d=\"M0,0 L10,5 L0,10 z\"/></marker></defs>\n"
      "<rect width=\"{0}\" height=\"{1}\" fill=\"#fff\"/>\n",
      kWidth, kHeight, robot.name);
  svg += Base(canvas, half_m);
  svg += ShapeGroup(shapes[0], canvas, body, straight, true);
  svg += ShapeGroup(shapes[1], canvas, body, bent, false);
  return svg + Legend(robot, canvas) + "</svg>\n";
}

}  // namespace tendril::first_robot
