# Debian packages by CPack (scripts/package, preset `package`): `idol` with the program and all it needs, `libidol-dev` with headers,
# static libraries and CMake files, `python3-idol` with the module for Debian's Python.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_VENDOR idol)
set(CPACK_PACKAGE_CONTACT "idol developers <idol@localhost>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY ${PROJECT_DESCRIPTION})
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_ALL program dev)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)

set(CPACK_DEBIAN_PROGRAM_PACKAGE_NAME idol)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_RECOMMENDS "libopenblas0-serial | libopenblas0")
set(CPACK_COMPONENT_PROGRAM_DESCRIPTION "Event-camera and IMU odometry with lines
 Estimates the trajectory of an event camera with an IMU, and a map of 3D line
 segments, from recordings as text, ROS 1 bags, AEDAT 4 or HDF5. Writes
 trajectories, lines and a report that opens in a browser.")

set(CPACK_DEBIAN_DEV_PACKAGE_NAME libidol-dev)
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEV_PACKAGE_DEPENDS "libeigen3-dev (>= 3.4), libceres-dev (>= 2.1), liblapack-dev, libyaml-cpp-dev, libfmt-dev, \
libzstd-dev, liblz4-dev, libbz2-dev, libhdf5-dev, libblosc-dev, liblzf-dev, zlib1g-dev, libpng-dev, libcairo2-dev, libcpp-httplib-dev, pkg-config")
set(CPACK_COMPONENT_DEV_DESCRIPTION "Event-camera and IMU odometry with lines (C++ library)
 Headers, static libraries and CMake files: find_package(idol) gives
 idol::odometry, idol::io, idol::tools and idol::jobs.")

if(TARGET idol_python)
  list(APPEND CPACK_COMPONENTS_ALL python)
  set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-idol)
  set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
  math(EXPR next_python "${Python_VERSION_MINOR} + 1")
  set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS "python3 (>= ${Python_VERSION_MAJOR}.${Python_VERSION_MINOR}), \
python3 (<< ${Python_VERSION_MAJOR}.${next_python}), python3-numpy")
  set(CPACK_COMPONENT_PYTHON_DESCRIPTION "Event-camera and IMU odometry with lines (Python module)
 The module idol: whole runs, streaming odometry on numpy arrays, reading and
 converting recordings, evaluation.")
endif()

# What Debian wants in each package beside that: licence and log of changes.
set(idol_packages program=idol dev=libidol-dev)
if(TARGET idol_python)
  list(APPEND idol_packages python=python3-idol)
endif()
string(TIMESTAMP idol_date "%a, %d %b %Y %H:%M:%S +0000" UTC)
file(WRITE ${PROJECT_BINARY_DIR}/changelog "idol (${PROJECT_VERSION}) unstable; urgency=medium\n\n"
  "  * Version ${PROJECT_VERSION}.\n\n -- ${CPACK_PACKAGE_CONTACT}  ${idol_date}\n")
file(COPY ${PROJECT_SOURCE_DIR}/docs/idol.1 DESTINATION ${PROJECT_BINARY_DIR})
foreach(file changelog idol.1)
  execute_process(COMMAND gzip -9nf ${PROJECT_BINARY_DIR}/${file} COMMAND_ERROR_IS_FATAL ANY)
endforeach()
install(FILES ${PROJECT_BINARY_DIR}/idol.1.gz DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 COMPONENT program)
foreach(package IN LISTS idol_packages)
  string(REPLACE "=" ";" package ${package})
  list(GET package 0 component)
  list(GET package 1 name)
  set(folder ${CMAKE_INSTALL_DATADIR}/doc/${name})
  install(FILES ${PROJECT_SOURCE_DIR}/LICENSE DESTINATION ${folder} RENAME copyright COMPONENT ${component}
    EXCLUDE_FROM_ALL)
  install(FILES ${PROJECT_BINARY_DIR}/changelog.gz DESTINATION ${folder} COMPONENT ${component} EXCLUDE_FROM_ALL)
endforeach()

include(CPack)
