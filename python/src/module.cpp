// The module tendril._core: thin names for the rooms. What is said to a user, and the checks of shapes, are
// in the package's Python files.
#include "module.h"

#include <nanobind/stl/string.h>

#include <string>

#include "interruptible.h"
#include "tendril/core/usage_error.h"
#include "tendril/core/version.h"

namespace nb = nanobind;

NB_MODULE(_core, m) {
  using namespace tendril;
  m.doc() = "The C++ rooms of Tendril, as the package tendril uses them. Programs import tendril instead.";
  // Threads of other packages may hold objects until Python ends; that is nothing to tell a user.
  nb::set_leak_warnings(false);
  m.attr("version") = std::string(Version());
  m.attr("revision") = std::string(GitRevision());
  nb::register_exception_translator([](const std::exception_ptr& p, void*) {
    try {
      std::rethrow_exception(p);
    } catch (const UsageError& e) {
      PyErr_SetString(PyExc_ValueError, e.what());
    }
  });
  m.def("await_abandoned", &python::AwaitAbandoned,
        "Waits for work that Ctrl-C left behind to end; called when Python ends.");
  python::AddRobot(m);
  python::AddModel(m);
  python::AddClient(m);
}
