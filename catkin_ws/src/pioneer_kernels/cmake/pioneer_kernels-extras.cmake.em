@[if DEVELSPACE]@
set(PIONEER_KERNELS_PYTHON "@(CMAKE_CURRENT_SOURCE_DIR)/src")
@[else]@
set(PIONEER_KERNELS_PYTHON "${pioneer_kernels_DIR}/../../../@(CATKIN_GLOBAL_PYTHON_DESTINATION)")
@[end if]@
set(PIONEER_CPU "host" CACHE STRING "LLVM processor name that kernels are compiled for; host, or x86-64 for an image")

# Sets <result> to <source> and every sibling kernel module that it imports, directly or through others.
function(pioneer_kernel_sources source result)
  set(found "${source}")
  set(pending "${source}")
  while(pending)
    list(POP_FRONT pending current)
    file(STRINGS "${current}" imports REGEX "^from ${PROJECT_NAME}\\.kernels\\.[a-z_]+ import")
    get_filename_component(folder "${current}" DIRECTORY)
    foreach(line ${imports})
      string(REGEX REPLACE "^from ${PROJECT_NAME}\\.kernels\\.([a-z_]+) import.*" "\\1" noun "${line}")
      set(sibling "${folder}/${noun}.py")
      if(NOT sibling IN_LIST found)
        list(APPEND found "${sibling}")
        list(APPEND pending "${sibling}")
      endif()
    endforeach()
  endwhile()
  set(${result} "${found}" PARENT_SCOPE)
endfunction()

# Compiles every kernel module src/<project>/kernels/<noun>.py of the calling package into the
# extension <project>._<noun>, importable without numba. A kernel module marks what it exports with pioneer_kernels' kernel decorator.
function(pioneer_compile_kernels)
  set(package_dir "${CMAKE_CURRENT_SOURCE_DIR}/src/${PROJECT_NAME}")
  set(output_dir "${CATKIN_DEVEL_PREFIX}/${CATKIN_GLOBAL_PYTHON_DESTINATION}/${PROJECT_NAME}")
  file(GLOB sources CONFIGURE_DEPENDS "${package_dir}/kernels/*.py")
  foreach(source ${sources})
    get_filename_component(noun "${source}" NAME_WE)
    if(noun STREQUAL "__init__")
      continue()
    endif()
    pioneer_kernel_sources("${source}" read)
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS "${source}")
    # The stamp stands in for the extension, whose file name carries the interpreter's ABI tag.
    set(stamp "${CMAKE_CURRENT_BINARY_DIR}/kernel_${noun}.stamp")
    add_custom_command(
      OUTPUT "${stamp}"
      COMMAND ${CMAKE_COMMAND} -E make_directory "${output_dir}"
      COMMAND ${CMAKE_COMMAND} -E env "PYTHONPATH=${PIONEER_KERNELS_PYTHON}" ${PYTHON_EXECUTABLE} -m pioneer_kernels.compile
        --source-root "${CMAKE_CURRENT_SOURCE_DIR}/src" --module "${PROJECT_NAME}.kernels.${noun}"
        --extension "_${noun}" --output "${output_dir}" --cpu "${PIONEER_CPU}"
      COMMAND ${CMAKE_COMMAND} -E touch "${stamp}"
      DEPENDS ${read} "${PIONEER_KERNELS_PYTHON}/pioneer_kernels/compile.py"
        "${PIONEER_KERNELS_PYTHON}/pioneer_kernels/declaration.py"
      COMMENT "Compiling kernel ${PROJECT_NAME}._${noun}"
      VERBATIM)
    add_custom_target(${PROJECT_NAME}_kernel_${noun} ALL DEPENDS "${stamp}")
    install(DIRECTORY "${output_dir}/" DESTINATION "${CATKIN_GLOBAL_PYTHON_DESTINATION}/${PROJECT_NAME}"
      FILES_MATCHING PATTERN "_${noun}.*.so")
  endforeach()
endfunction()
