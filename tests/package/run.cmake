# run(OUT COMMAND...): its output; a fatal error with all that it said if it fails.
function(run out)
  execute_process(COMMAND ${ARGN} OUTPUT_VARIABLE said ERROR_VARIABLE complained RESULT_VARIABLE status)
  if(NOT status EQUAL 0)
    message(FATAL_ERROR "${ARGN}\nended with ${status}\n${said}${complained}")
  endif()
  set(${out} "${said}" PARENT_SCOPE)
endfunction()
