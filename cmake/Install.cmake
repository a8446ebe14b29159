# What `cmake --install` puts where: the program with what belongs to it (component `program`), and the library
# (component `dev`).
include(CMakePackageConfigHelpers)

install(TARGETS idol RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT program)
file(GLOB idol_configs CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/configs/*.yaml)
install(FILES ${idol_configs} DESTINATION ${CMAKE_INSTALL_DATADIR}/idol COMPONENT program)
if(NOT IDOL_DEBIAN)  # there it is compressed
  install(FILES docs/idol.1 DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 COMPONENT program)
endif()
foreach(shell bash zsh)
  add_custom_command(TARGET idol POST_BUILD VERBATIM
    COMMAND idol completion ${shell} > ${PROJECT_BINARY_DIR}/completion.${shell})
endforeach()
install(FILES ${PROJECT_BINARY_DIR}/completion.bash DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions
  RENAME idol COMPONENT program)
install(FILES ${PROJECT_BINARY_DIR}/completion.zsh DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/vendor-completions
  RENAME _idol COMPONENT program)

# A shared library belongs to the program as well, its name for the linker to the library's users.
install(TARGETS ${IDOL_LIBRARIES} EXPORT idolTargets
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT dev
  LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT program NAMELINK_COMPONENT dev)
set(idol_cmake_dir ${CMAKE_INSTALL_LIBDIR}/cmake/idol)
install(EXPORT idolTargets NAMESPACE idol:: DESTINATION ${idol_cmake_dir} COMPONENT dev)
configure_package_config_file(cmake/idolConfig.cmake.in ${PROJECT_BINARY_DIR}/idolConfig.cmake
  INSTALL_DESTINATION ${idol_cmake_dir})
# Before 1.0 a new minor version may change anything.
write_basic_package_version_file(${PROJECT_BINARY_DIR}/idolConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/idolConfig.cmake ${PROJECT_BINARY_DIR}/idolConfigVersion.cmake
  cmake/Dependencies.cmake DESTINATION ${idol_cmake_dir} COMPONENT dev)

# The headers that users begin at; those they include come with them.
set(idol_doors idol/version.hpp idol/odometry/presets.hpp idol/imu/imu_init.hpp idol/io/reader.hpp
  idol/io/recording_summary.hpp idol/io/recording_writer.hpp idol/io/trajectory_io.hpp
  idol/eval/evaluation_input.hpp idol/eval/evaluation_output.hpp idol/sim/simulator.hpp idol/report/report.hpp
  idol/jobs/recording_run.hpp idol/jobs/convert_recording.hpp idol/base/ready_rigs.hpp)
install(CODE "
  set(IDOL_DOORS \"${idol_doors}\")
  set(IDOL_HEADER_PATHS \"${PROJECT_SOURCE_DIR}/src;${IDOL_GENERATED_DIR}\")
  set(IDOL_HEADER_DESTINATION \"\${CMAKE_INSTALL_PREFIX}/${CMAKE_INSTALL_INCLUDEDIR}\")
  include(\"${PROJECT_SOURCE_DIR}/cmake/InstallHeaders.cmake\")" COMPONENT dev)
