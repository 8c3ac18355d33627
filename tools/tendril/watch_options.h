// What `tendril gap accept`, `gap watch` and `gap history` have in common: options, and the words for the
// Python package, which keeps and compares. Knows nothing of how.
#pragma once

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <string>
#include <utility>
#include <vector>

#include "python_program.h"

namespace tendril::tools {

/// The words of the Python program; an option that was not given is left to it.
struct Words {
  std::vector<std::string> list;

  void Add(const std::string& option, const std::string& value) {
    if (!value.empty()) list.push_back(fmt::format("{}={}", option, value));
  }
  void Add(const std::string& option, double value) {
    if (value > 0) list.push_back(fmt::format("{}={}", option, value));
  }
  void AddFlag(const std::string& option, bool given) {
    if (given) list.push_back(option);
  }
};

struct EntryOptions {
  std::string db, robot, at;
  bool same_robot = false;
  std::vector<std::string> data;

  void AddTo(Words& words) const {
    words.Add("--db", db);
    words.Add("--robot", robot);
    words.Add("--at", at);
    words.AddFlag("--same-robot", same_robot);
  }
};

inline void AddDatabase(CLI::App& command, std::string& db) {
  command.add_option("--db", db, "database of watched robots (SQLite)")->required();
}

inline void AddEntryOptions(CLI::App& command, EntryOptions& entry, const char* data) {
  AddDatabase(command, entry.db);
  command.add_option("--robot", entry.robot, "robot file")->required();
  command.add_option(
      "--at", entry.at,
      "when the runs were recorded, YYYY-MM-DD or YYYY-MM-DDTHH:MM (UTC); default: the date that "
      "the names of folders or logs begin with, or when the newest file was written");
  command.add_flag("--same-robot", entry.same_robot,
                   "the runs are of the robot of --robot although their own robot file differs");
  command.add_option("data", entry.data, data)->required();
}

inline void AddPage(CLI::App& command, std::string& page) {
  command.add_option("--page", page, "the course of every number as a page (HTML), written anew each time");
}

/// Becomes the package's program for `what`.
[[noreturn]] inline void HandToWatch(const std::string& what, Words words,
                                     const std::vector<std::string>& data,
                                     const std::vector<std::string>& modules) {
  words.list.insert(words.list.begin(), what);
  if (!data.empty()) words.list.emplace_back("--");
  words.list.insert(words.list.end(), data.begin(), data.end());
  RunPython("tendril.watch", words.list, modules);
}

}  // namespace tendril::tools
