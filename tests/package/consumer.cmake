# Configures, builds and runs examples/consumer against the installed library.
include(${CMAKE_CURRENT_LIST_DIR}/run.cmake)
file(REMOVE_RECURSE ${FOLDER})
run(ignored ${CMAKE_COMMAND} -G ${GENERATOR} -S ${SOURCE} -B ${FOLDER} -DCMAKE_CXX_COMPILER=${COMPILER}
  -DCMAKE_PREFIX_PATH=${PREFIX} -DCMAKE_BUILD_TYPE=Release)
run(ignored ${CMAKE_COMMAND} --build ${FOLDER})
run(said ${FOLDER}/consumer ${DEMO} 2)
# Two seconds, the first at rest.
if(NOT said MATCHES "idol ${VERSION}: [34][0-9] poses, RMSE 0.00")
  message(FATAL_ERROR "the consumer says: ${said}")
endif()
