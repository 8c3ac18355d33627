// Structures as a header or an LCM file declares them, with the comments that say what their members are.
// Reads the project's own style: a comment before a structure, one behind each member or a group of members.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace tendril::reference {

struct Member {
  std::string type;     // "double"
  std::string name;     // "rms"
  std::string extent;   // of an array: "num_bending"
  std::string value;    // of a constant or with a default
  std::string comment;  // what it is; empty: none
  bool constant = false;
  std::string group;  // the comment that stands alone before it and those that follow
};

struct Structure {
  std::string name, comment;
  std::vector<Member> members;
};

std::vector<Structure> ReadDeclarations(const std::filesystem::path& file);
/// The comment of "CutFinding::rms"; empty where there is none.
std::string CommentOf(const std::vector<Structure>& structures, std::string_view member);

}  // namespace tendril::reference
