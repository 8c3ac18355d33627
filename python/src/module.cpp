// The module tendril._core: thin names for the rooms. What is said to a user, and the checks of shapes, are
// in the package's Python files.
#include "module.h"

#include <nanobind/stl/string.h>

#include <stdexcept>
#include <string>

#include "interruptible.h"
#include "rows.h"
#include "tendril/config/config.h"
#include "tendril/core/usage_error.h"
#include "tendril/core/version.h"

namespace nb = nanobind;

namespace {

/// Raises an exception of tendril.errors.
template <class... Arguments>
void Raise(const char* type_name, const Arguments&... arguments) {
  const nb::object type = nb::module_::import_("tendril.errors").attr(type_name);
  PyErr_SetObject(type.ptr(), type(arguments...).ptr());
}

void Translate(const std::exception_ptr& p, void*) {
  try {
    std::rethrow_exception(p);
  } catch (const tendril::python::RowError& e) {
    Raise("ModelError", e.what(), e.row);
  } catch (const tendril::config::ConfigError& e) {
    Raise("ConfigError", e.what());
  } catch (const tendril::UsageError& e) {
    PyErr_SetString(PyExc_ValueError, e.what());
  } catch (const std::runtime_error& e) {
    Raise("Error", e.what());
  }
}

}  // namespace

NB_MODULE(_core, m) {
  using namespace tendril;
  m.doc() = "The C++ rooms of Tendril, as the package tendril uses them. Programs import tendril instead.";
  // Threads of other packages may hold objects until Python ends; that is nothing to tell a user.
  nb::set_leak_warnings(false);
  m.def("version", [] { return std::string(Version()); });
  m.def("revision", [] { return std::string(GitRevision()); });
  nb::register_exception_translator(&Translate);
  m.def("await_abandoned", &python::AwaitAbandoned,
        "Waits for work that Ctrl-C left behind to end; called when Python ends.");
  python::AddRobot(m);
  python::AddModel(m);
  python::AddDataSet(m);
  python::AddSimulate(m);
  python::AddDiagnose(m);
  python::AddLog(m);
  python::AddReplay(m);
  python::AddClient(m);
  python::AddStatus(m);
}
