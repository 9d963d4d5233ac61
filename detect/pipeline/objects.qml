<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<qgis version="3.22" styleCategories="Symbology|Labeling" labelsEnabled="1">
 <renderer-v2 type="categorizedSymbol" attr="kind" enableorderby="0" symbollevels="0" forceraster="0">
  <categories>
   <category value="afloat" symbol="0" label="afloat" render="true"/>
   <category value="round" symbol="3" label="round: cloud, islet or platform" render="true"/>
   <category value="alongside" symbol="1" label="alongside: ship or short pier" render="true"/>
   <category value="" symbol="2" label="anomaly" render="true"/>
  </categories>
  <symbols>
   <symbol type="fill" name="0" alpha="1"><layer class="SimpleLine" enabled="1" pass="0">
    <Option type="Map"><Option name="line_color" type="QString" value="255,60,0,255"/>
    <Option name="line_width" type="QString" value="0.7"/></Option></layer></symbol>
   <symbol type="fill" name="1" alpha="1"><layer class="SimpleLine" enabled="1" pass="0">
    <Option type="Map"><Option name="line_color" type="QString" value="255,200,0,255"/>
    <Option name="line_width" type="QString" value="0.4"/></Option></layer></symbol>
   <symbol type="fill" name="2" alpha="1"><layer class="SimpleLine" enabled="1" pass="0">
    <Option type="Map"><Option name="line_color" type="QString" value="255,0,200,255"/>
    <Option name="line_width" type="QString" value="0.5"/></Option></layer></symbol>
   <symbol type="fill" name="3" alpha="1"><layer class="SimpleLine" enabled="1" pass="0">
    <Option type="Map"><Option name="line_color" type="QString" value="160,160,160,255"/>
    <Option name="line_width" type="QString" value="0.4"/></Option></layer></symbol>
  </symbols>
 </renderer-v2>
 <labeling type="simple"><settings><text-style fieldName="label" fontSize="8" isExpression="0"/></settings></labeling>
</qgis>
