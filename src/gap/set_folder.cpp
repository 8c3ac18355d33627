// Files of a set are moved one by one, so that other files in the folder stay; see the header.
#include "tendril/gap/set_folder.h"

#include <fmt/format.h>
#include <unistd.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <stdexcept>

#include "tendril/config/config.h"
#include "tendril/config/whole_file.h"
#include "tendril/core/usage_error.h"

namespace tendril::gap {
namespace {

namespace fs = std::filesystem;

constexpr const char *kList = "runs.yaml", *kRobot = "robot.yaml";

bool IsTable(const fs::path& file) {
  std::string ending = file.extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; });
  return ending == ".csv";
}

/// Plain file names that a list of runs names.
std::set<std::string> ListedIn(const fs::path& file) {
  std::set<std::string> names;
  try {
    YAML::Node list = YAML::Load(config::ReadWhole(file));
    if (list.IsMap() && list["runs"]) list.reset(list["runs"]);
    for (const YAML::Node& entry : list) {
      const YAML::Node name = entry.IsMap() ? entry["file"] : entry;
      if (!name || !name.IsScalar()) continue;
      const fs::path path = name.Scalar();
      // A list may name files elsewhere; those are not this folder's.
      if (IsTable(path) && path.filename() == path) names.insert(path.string());
    }
  } catch (const YAML::Exception& e) {
    throw UsageError(fmt::format("{}:{}: not YAML, so it is unknown what may be replaced; give another --out",
                                 file.string(), e.mark.line + 1));
  }
  return names;
}

/// A robot file as a program writes it: nothing of a person's would be lost with it.
bool IsWritten(const fs::path& file) {
  const std::string text = config::ReadWhole(file);
  if (text.find('#') == text.npos) return true;
  try {
    return config::ToYaml(config::ParseRobot(text, file.string())) == text;
  } catch (const std::exception&) {
    return false;
  }
}

std::string Some(const std::vector<std::string>& names) {
  constexpr std::size_t kShown = 3;
  std::string text;
  for (std::size_t i = 0; i < std::min(names.size(), kShown); ++i) text += (i ? ", " : "") + names[i];
  if (names.size() > kShown) text += fmt::format(" and {} more", names.size() - kShown);
  return text;
}

/// The nearest folder that there is.
fs::path Existing(fs::path folder) {
  folder = fs::absolute(folder).lexically_normal();
  std::error_code ignored;
  while (!fs::exists(folder, ignored) && folder.has_relative_path()) folder = folder.parent_path();
  return folder;
}

bool MayMakeFilesIn(const fs::path& folder) {
  std::error_code ignored;
  return fs::is_directory(folder, ignored) && access(folder.c_str(), W_OK | X_OK) == 0;
}

/// Files of a folder under other names for a while; gone with everything in it at the end.
class Aside {
 public:
  explicit Aside(const fs::path& path) : path_(path) {
    std::error_code error;
    fs::remove_all(path_, error);
    if (!fs::create_directories(path_, error) || error) {
      throw std::runtime_error("cannot write into " + path_.parent_path().string() +
                               ": choose another folder with --out");
    }
  }
  ~Aside() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  Aside(const Aside&) = delete;
  Aside& operator=(const Aside&) = delete;
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

}  // namespace

SetFolder::SetFolder(fs::path folder, bool overwrite, const std::vector<std::string>& inputs)
    : folder_(std::move(folder)) {
  if (!folder_.has_filename()) folder_ = folder_.parent_path();  // of a name with a slash at its end
  if (!MayMakeFilesIn(Existing(folder_))) {
    throw std::runtime_error("cannot write into " + folder_.string() + ": choose another folder with --out");
  }
  std::vector<std::string> there;
  bool list = false;
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(folder_, ignored)) {
    const std::string name = entry.path().filename().string();
    if (name == kList || name == kRobot || IsTable(name)) there.push_back(name);
    list = list || name == kList;
  }
  std::sort(there.begin(), there.end());
  if (there.empty()) return;
  if (!overwrite) {
    throw UsageError(fmt::format(
        "{} already holds a data set ({}); give another --out, or --overwrite to replace the runs that "
        "its runs.yaml lists",
        folder_.string(), Some(there)));
  }
  if (list) {
    if (fs::is_regular_file(folder_ / kList, ignored)) old_ = ListedIn(folder_ / kList);
    old_.insert(kList);
  }
  if (fs::exists(folder_ / kRobot, ignored)) old_.insert(kRobot);
  for (const std::string& name : old_) {
    const fs::path file = folder_ / name;
    RefuseToReplace(file.string(), "--out", inputs);
    if (fs::exists(file, ignored) && !fs::is_regular_file(file, ignored))
      throw UsageError(file.string() + " is not a file; give another --out, or move it away");
  }
  if (old_.contains(kRobot) && !IsWritten(folder_ / kRobot)) {
    throw UsageError(fmt::format(
        "{} has comments, so it is not a copy that may be replaced; give another --out, or move it away",
        (folder_ / kRobot).string()));
  }
}

void SetFolder::CheckNames(const std::vector<std::string>& runs) const {
  std::error_code ignored;
  for (const std::string& run : runs) {
    const std::string file = run + ".csv";
    if (old_.contains(file) || !fs::exists(folder_ / file, ignored)) continue;
    throw UsageError(fmt::format(
        "{} already exists and is not a run of an earlier set; give another --out, or move it away",
        (folder_ / file).string()));
  }
}

void SetFolder::Write(const DataSet& set) const {
  std::vector<std::string> runs;
  for (const Run& run : set.runs) runs.push_back(run.name);
  CheckNames(runs);
  const Aside next(folder_ / fmt::format(".next-{}", getpid())),
      last(folder_ / fmt::format(".last-{}", getpid()));
  WriteDataSet(set, next.path());

  std::vector<fs::path> from_next, from_last;
  const auto take_back = [&] {
    std::error_code ignored;
    for (const fs::path& name : from_next) fs::remove(folder_ / name, ignored);
    for (const fs::path& name : from_last) fs::rename(last.path() / name, folder_ / name, ignored);
  };
  try {
    for (const std::string& name : old_) {
      if (!fs::exists(folder_ / name)) continue;
      fs::rename(folder_ / name, last.path() / name);
      from_last.emplace_back(name);
    }
    std::vector<fs::path> files;
    for (const auto& entry : fs::directory_iterator(next.path())) files.push_back(entry.path().filename());
    // The list comes last: until it is there, no set is.
    std::sort(files.begin(), files.end(),
              [](const fs::path& a, const fs::path& b) { return (a == kList) < (b == kList); });
    for (const fs::path& name : files) {
      fs::rename(next.path() / name, folder_ / name);
      from_next.push_back(name);
    }
  } catch (const fs::filesystem_error& e) {
    take_back();
    throw std::runtime_error(fmt::format("cannot write into {} ({}): choose another folder with --out",
                                         folder_.string(), e.code().message()));
  }
}

fs::path SetFolder::WriteIncomplete(const DataSet& set) const {
  if (!replaces()) {
    Write(set);
    return folder_;
  }
  const std::string name = fs::weakly_canonical(folder_).string() + ".incomplete";
  fs::path beside = name;
  for (int n = 2; fs::exists(beside); ++n) beside = fmt::format("{}-{}", name, n);
  SetFolder(beside, false, {}).Write(set);
  return beside;
}

void RefuseToReplace(const std::string& file, const char* option, const std::vector<std::string>& inputs) {
  for (const std::string& input : inputs) {
    std::error_code ignored;
    if (input.empty() || !fs::equivalent(file, input, ignored)) continue;
    throw UsageError(
        fmt::format("{} would replace {}, which is read here; give another {}", file, input, option));
  }
}

void CheckWritable(const std::string& file) {
  std::error_code ignored;
  const bool may = fs::exists(file, ignored)
                       ? !fs::is_directory(file, ignored) && access(file.c_str(), W_OK) == 0
                       : MayMakeFilesIn(fs::absolute(file).parent_path());
  if (!may)
    throw std::runtime_error("cannot write " + file +
                             "; name a file in a folder that exists and may be written");
}

}  // namespace tendril::gap
