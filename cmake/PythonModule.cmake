# Builds the Python module if what it needs is there (pybind11, Python's headers), and says so if not.

# Debian's numpy and pytest belong to Debian's Python, not to one that comes first on the PATH; in a virtual
# environment its own is meant.
if(NOT Python_EXECUTABLE AND NOT DEFINED ENV{VIRTUAL_ENV} AND EXISTS /usr/bin/python3)
  set(Python_EXECUTABLE /usr/bin/python3)
endif()
find_package(Python 3.9 COMPONENTS Interpreter Development.Module QUIET)
if(Python_FOUND)
  find_package(pybind11 2.10 CONFIG QUIET)
endif()
if(Python_FOUND AND pybind11_FOUND)
  file(GLOB IDOL_PYTHON_SOURCES CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/python/src/*.cpp
    ${PROJECT_SOURCE_DIR}/python/src/*.hpp)
  add_subdirectory(python)
else()
  message(STATUS "Without the Python module: it needs Python's headers and pybind11 (python3-dev, pybind11-dev)")
endif()
