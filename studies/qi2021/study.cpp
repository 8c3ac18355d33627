#include "study.h"

#include <cmath>
#include <cstring>
#include <stdexcept>

#include "tendril/config/config.h"

namespace tendril::qi2021 {

Series::Series(const std::filesystem::path& path, const std::vector<std::string>& columns)
    : file_([&] {
        std::FILE* f = std::fopen(path.c_str(), "w");
        if (!f)
          throw std::runtime_error(fmt::format("cannot write {}: {}", path.string(), std::strerror(errno)));
        return f;
      }()),
      writer_(file_.get(), columns) {}

void Study::Begin(const std::string& stage) {
  End();
  stage_ = stage;
  progress_(stage_, 0, false);
}

void Study::End() {
  if (!stage_.empty()) progress_(stage_, 1, true);
  stage_.clear();
}

RobotParameters Study::Robot(const std::string& name) const { return config::LoadRobot(find_(name)); }
DaemonParameters Study::Daemon() const { return config::LoadDaemon(find_("tendrild.yaml")); }

double Apart(double ours, double paper) { return std::abs(ours - paper) / std::abs(paper); }

}  // namespace tendril::qi2021
