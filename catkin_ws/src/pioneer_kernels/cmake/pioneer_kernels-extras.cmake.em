@[if DEVELSPACE]@
set(PIONEER_KERNELS_PYTHON "@(CMAKE_CURRENT_SOURCE_DIR)/src")
@[else]@
set(PIONEER_KERNELS_PYTHON "${pioneer_kernels_DIR}/../../../@(CATKIN_GLOBAL_PYTHON_DESTINATION)")
@[end if]@
set(PIONEER_CPU "host" CACHE STRING "LLVM processor name that kernels are compiled for; host, or x86-64 for an image")

# Sets <result> to <source> and every module of the package that it imports, directly or through others.
function(pioneer_kernel_sources source result)
  set(found "${source}")
  set(pending "${source}")
  while(pending)
    list(POP_FRONT pending current)
    file(STRINGS "${current}" imports REGEX "^from ${PROJECT_NAME}\\.[a-z_.]+ import")
    foreach(line ${imports})
      string(REGEX REPLACE "^from ([a-z_.]+) import.*" "\\1" module "${line}")
      string(REPLACE "." "/" path "${module}")
      set(imported "${CMAKE_CURRENT_SOURCE_DIR}/src/${path}.py")
      if(EXISTS "${imported}" AND NOT imported IN_LIST found)
        list(APPEND found "${imported}")
        list(APPEND pending "${imported}")
      endif()
    endforeach()
  endwhile()
  set(${result} "${found}" PARENT_SCOPE)
endfunction()

# Compiles every kernel module of the calling package, <noun>_kernel.py anywhere below src/<project>, into the extension
# <project>._<noun>, importable without numba. A kernel module marks what it exports with pioneer_kernels' kernel decorator.
# The nouns of a package differ, also between folders.
function(pioneer_compile_kernels)
  set(package_dir "${CMAKE_CURRENT_SOURCE_DIR}/src/${PROJECT_NAME}")
  set(output_dir "${CATKIN_DEVEL_PREFIX}/${CATKIN_GLOBAL_PYTHON_DESTINATION}/${PROJECT_NAME}")
  file(GLOB_RECURSE sources CONFIGURE_DEPENDS "${package_dir}/*_kernel.py")
  foreach(source ${sources})
    get_filename_component(noun "${source}" NAME_WE)
    string(REGEX REPLACE "_kernel$" "" noun "${noun}")
    file(RELATIVE_PATH module "${CMAKE_CURRENT_SOURCE_DIR}/src" "${source}")
    string(REGEX REPLACE "\\.py$" "" module "${module}")
    string(REPLACE "/" "." module "${module}")
    pioneer_kernel_sources("${source}" read)
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS "${source}")
    # The stamp stands in for the extension, whose file name carries the interpreter's ABI tag.
    set(stamp "${CMAKE_CURRENT_BINARY_DIR}/kernel_${noun}.stamp")
    add_custom_command(
      OUTPUT "${stamp}"
      COMMAND ${CMAKE_COMMAND} -E make_directory "${output_dir}"
      COMMAND ${CMAKE_COMMAND} -E env "PYTHONPATH=${PIONEER_KERNELS_PYTHON}" ${PYTHON_EXECUTABLE} -m pioneer_kernels.build
        --reads ${read}
        --source-root "${CMAKE_CURRENT_SOURCE_DIR}/src" --module "${module}"
        --extension "_${noun}" --output "${output_dir}" --cpu "${PIONEER_CPU}"
      COMMAND ${CMAKE_COMMAND} -E touch "${stamp}"
      DEPENDS ${read} "${PIONEER_KERNELS_PYTHON}/pioneer_kernels/build.py"
        "${PIONEER_KERNELS_PYTHON}/pioneer_kernels/compile.py"
        "${PIONEER_KERNELS_PYTHON}/pioneer_kernels/declaration.py"
      COMMENT "Compiling kernel ${PROJECT_NAME}._${noun}"
      VERBATIM)
    add_custom_target(${PROJECT_NAME}_kernel_${noun} ALL DEPENDS "${stamp}")
    install(DIRECTORY "${output_dir}/" DESTINATION "${CATKIN_GLOBAL_PYTHON_DESTINATION}/${PROJECT_NAME}"
      FILES_MATCHING PATTERN "_${noun}.*.so")
  endforeach()
endfunction()
