// LCM logs message by message, past damage, and what is a message of this version.
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/string_view.h>

#include <span>
#include <string>

#include "module.h"
#include "tendril/io/log_messages.h"

namespace tendril::python {
namespace {

namespace nb = nanobind;

nb::str Text(std::string_view text) {
  // Names of channels are whatever another program sent.
  PyObject* decoded = PyUnicode_DecodeUTF8(text.data(), static_cast<Py_ssize_t>(text.size()), "replace");
  if (decoded == nullptr) nb::raise_python_error();
  return nb::steal<nb::str>(decoded);
}

/// Names of files are bytes, whatever Python makes of them.
std::string FileName(const nb::str& path) {
  PyObject* bytes = nullptr;
  if (PyUnicode_FSConverter(path.ptr(), &bytes) == 0) nb::raise_python_error();
  const auto held = nb::steal<nb::bytes>(bytes);
  return {held.c_str(), held.size()};
}

nb::list Next(io::LogMessages& log, std::size_t most) {
  nb::list messages;
  while (nb::len(messages) < most && log.Next()) {
    const io::LogMessage& m = log.message();
    messages.append(nb::make_tuple(Text(m.channel), Text(m.type), m.stamp_us,
                                   nb::bytes(reinterpret_cast<const char*>(m.data.data()), m.data.size())));
  }
  return messages;
}

}  // namespace

void AddLog(nb::module_& m) {
  nb::class_<io::LogMessages>(m, "LogMessages",
                              "The messages of an LCM log in the order of the file, past damage.")
      .def(
          "__init__",
          [](io::LogMessages* log, const nb::str& path) { new (log) io::LogMessages(FileName(path)); },
          nb::arg("path"))
      .def("next", &Next, nb::arg("most"),
           nb::sig("def next(self, most: int) -> list[tuple[str, str, int, bytes]]"),
           "Channel, type ('' where it is none of this version), stamp [us] and bytes of up to `most` "
           "messages; "
           "empty at the end.")
      .def_prop_ro("size", &io::LogMessages::size, "Bytes of the file.")
      .def_prop_ro("position", &io::LogMessages::position, "Bytes of it before the last message.")
      .def("damage", &io::LogMessages::Damage, "Damaged places by their bytes, in one line; empty: none.");
  m.def(
      "message_type",
      [](const nb::bytes& data) {
        return Text(io::TypeOfMessage({static_cast<const std::uint8_t*>(data.data()), data.size()}));
      },
      nb::arg("data"), nb::sig("def message_type(data: bytes) -> str"),
      "Type of lcm_types that the bytes are exactly one message of; '' where they are none of this version.");
  m.def("is_channel_of_tendril", &io::IsChannelOfTendril, nb::arg("channel"),
        nb::sig("def is_channel_of_tendril(channel: str) -> bool"),
        "Whether a channel is named as Tendril names its own.");
}

}  // namespace tendril::python
